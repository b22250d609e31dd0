#pragma once
// The driver: samples of all pixels, in tiles, on many threads. The result depends only on the scene, the
// seed and the sample range.

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <vector>

#include "base/sums.h"
#include "transport/channels.h"

namespace lajolla {

// Tiles are squares of pixels, and the unit of work. Each tile has two halves, like the black and the white
// fields of a chessboard, whose pixels may take different numbers of samples.
constexpr int tile_size = 16;

struct Tile {
    int x0, y0, x1, y1; // within the crop window
};
std::vector<Tile> tiles_of(const Film &film);
std::vector<Tile> tiles_of(const Film &film, int first_row, int end_row);

// The half of a tile to which a pixel belongs; x and y are pixels of the whole film.
constexpr std::size_t half_of(std::uint32_t x, std::uint32_t y) { return (x + y) & 1; }

// Indices of samples.
struct SampleRange {
    std::uint32_t first, end;
};

// The number of samples of a tile, of which the pixels of each half take a range.
std::uint64_t sample_count(const Film &film, const Tile &tile, const std::array<SampleRange, 2> &halves);

// The samples to take.
struct Job {
    SequenceKind sequence;
    std::uint32_t seed;
    std::vector<std::array<SampleRange, 2>> ranges; // of the halves of each tile
    int threads;                                    // 0: as many as the machine has
    bool one_lane = false;                          // follow one path after the other, with the same result
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
    std::atomic<std::uint64_t> samples{0};
    std::atomic<bool> cancelled{false};
};

// The radiance of one sample of the picture, filter weight included.
Spectrum sample_radiance(const Scene &scene, const Integrator &integrator, SequenceKind sequence,
                         std::uint32_t seed, SampleId id, Tracer &tracer);

// Called with the sums of a finished tile's samples: channel_count() for each of its pixels, row by row.
using TileDone = std::function<void(std::size_t index, const Tile &tile, const Sums &sums)>;

// Takes the job's samples. `done` may be called from several threads at a time. If the job is cancelled,
// tiles that are not finished are left out.
Report render(const Scene &scene, const Output &output, const Job &job, Progress &progress,
              const TileDone &done);

// The rays of a job, one list per tile; and the time in seconds that Embree takes for them.
using Recording = std::vector<std::vector<RecordedRay>>;
Recording record(const Scene &scene, const Output &output, const Job &job);
double replay_seconds(const Scene &scene, const Recording &recording, int threads);

} // namespace lajolla
