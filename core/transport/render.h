#pragma once
// The driver: samples of all pixels, in tiles, on many threads. The result depends only on the scene, the
// seed and the sample range.

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "transport/channels.h"

namespace lajolla {

// The samples to take.
struct Job {
    SequenceKind sequence;
    std::uint32_t seed;
    std::uint32_t first, count; // sample indices of every pixel
    int threads;                // 0: as many as the machine has
    bool one_lane = false;      // follow one path after the other, with the same result
};

// Statistics of a render.
struct Report {
    static constexpr std::size_t kept_samples = 16;
    std::uint64_t rays = 0;
    std::uint64_t nonfinite = 0;             // samples that were NaN or infinite, and count as black
    std::vector<SampleId> nonfinite_samples; // the first of them, in the order of tiles
};

// The progress of a running job, and whether to stop it.
struct Progress {
    std::atomic<std::uint64_t> pixels{0};
    std::atomic<bool> cancelled{false};
};

// The radiance of one sample of the picture, filter weight included.
Spectrum sample_radiance(const Scene &scene, const Integrator &integrator, SequenceKind sequence,
                         std::uint32_t seed, SampleId id, Tracer &tracer);

// Adds the job's samples, in order, to the sums of the crop window's pixels: channel_count() doubles each,
// row by row. Returns nullopt if the job was cancelled; the sums are then invalid.
std::optional<Report> render(const Scene &scene, const Output &output, const Job &job, std::span<double> sums,
                             Progress &progress);

// The rays of a job, one list per tile; and the time in seconds that Embree takes for them.
using Recording = std::vector<std::vector<RecordedRay>>;
Recording record(const Scene &scene, const Output &output, const Job &job);
double replay_seconds(const Scene &scene, const Recording &recording, int threads);

} // namespace lajolla
