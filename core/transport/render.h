#pragma once
// The list of integrators, and the driver: samples of all pixels, in tiles, on many threads. The result
// depends on the scene, the seed and the sample range alone.

#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "transport/path.h"
#include "transport/views.h"
#include "transport/volpath.h"

namespace lajolla {

using Integrator =
    std::variant<Path, VolPath, Depth, ShadingNormal, MeanCurvature, RayDifferentialView, MipmapLevel>;

// One sample of one pixel; pixels count over the whole film.
struct SampleId {
    std::uint32_t x, y, index;
};

// Which samples to take.
struct Job {
    SequenceKind sequence;
    std::uint32_t seed;
    std::uint32_t first, count; // sample indices of every pixel
    int threads;                // 0: as many as the machine has
};

// What rendering reports besides the picture.
struct Report {
    static constexpr std::size_t kept_samples = 16;
    std::uint64_t rays = 0;
    std::uint64_t nonfinite = 0;             // samples that were NaN or infinite, and count as black
    std::vector<SampleId> nonfinite_samples; // the first of them, in the order of pixels
};

// How far a running job is, and whether to stop it.
struct Progress {
    std::atomic<std::uint64_t> pixels{0};
    std::atomic<bool> cancelled{false};
};

// The radiance of one sample, filter weight included.
Spectrum sample_radiance(const Scene &scene, const Integrator &integrator, SequenceKind sequence,
                         std::uint32_t seed, SampleId id, Tracer &tracer);

// Adds the job's samples, in order, to the sums of the crop window's pixels: three doubles each, row by row.
// Returns nothing where the job was cancelled; the sums are meaningless then.
std::optional<Report> render(const Scene &scene, const Integrator &integrator, const Job &job,
                             std::span<double> sums, Progress &progress);

// The rays of a job, one list per tile, and the time in seconds that the ray tracer alone takes for them.
using Recording = std::vector<std::vector<RecordedRay>>;
Recording record(const Scene &scene, const Integrator &integrator, const Job &job);
double replay_seconds(const Scene &scene, const Recording &recording, int threads);

} // namespace lajolla
