#pragma once
// The driver: samples of all pixels, in tiles, on many threads. The result depends only on the scene, the
// seed and the sample range.

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/sums.h"
#include "transport/channels.h"

namespace lajolla {

// Tiles are squares of pixels, and the unit of work. They consist of four cells, and each cell of two halves,
// like the black and the white fields of a chessboard. Each half may take another number of samples.
constexpr int tile_size = 16, cell_size = tile_size / 2;

struct Tile {
    int x0, y0, x1, y1; // within the crop window
};
std::vector<Tile> tiles_of(const Film &film);
std::vector<Tile> tiles_of(const Film &film, int first_row, int end_row);

// A value for each half of all cells of the crop window.
template <class T>
class PerHalf {
public:
    explicit PerHalf(const Film &film, T value = {})
        : columns_(cells(film.crop_width)), rows_(cells(film.crop_height)),
          parity_(static_cast<std::uint32_t>(film.crop_offset_x + film.crop_offset_y)),
          values_(2 * columns_ * rows_, value) {}

    std::size_t rows() const { return rows_; }
    std::size_t columns() const { return columns_; }
    std::span<T> values() { return values_; } // cell by cell, row by row, the halves of a cell side by side
    std::span<const T> values() const { return values_; }

    // The value of a pixel's half; x and y are within the crop window. If they are even on the whole film, or
    // both odd, it is the first half.
    const T &at(std::uint32_t x, std::uint32_t y) const { return values_[index(x, y)]; }
    T &at(std::uint32_t x, std::uint32_t y) { return values_[index(x, y)]; }

private:
    static std::size_t cells(int pixels) {
        return static_cast<std::size_t>((pixels + cell_size - 1) / cell_size);
    }
    std::size_t index(std::uint32_t x, std::uint32_t y) const {
        return 2 * (y / cell_size * columns_ + x / cell_size) + ((x + y + parity_) & 1);
    }

    std::size_t columns_, rows_;
    std::uint32_t parity_;
    std::vector<T> values_;
};

// Indices of samples.
struct SampleRange {
    std::uint32_t first = 0, end = 0;
    std::uint32_t size() const { return end - first; }
};
using SampleRanges = PerHalf<SampleRange>;

std::uint64_t sample_count(const Tile &tile, const SampleRanges &ranges);

// The samples to take.
struct Job {
    SequenceKind sequence;
    std::uint32_t seed;
    SampleRanges ranges;
    int threads;           // 0: as many as the machine has
    bool one_lane = false; // follow one path after the other, with the same result
};

// Statistics of a render.
struct Report {
    static constexpr std::size_t kept_samples = 16;
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

// Called with the sums of a finished tile's samples, if there are any: channel_count() for each of its
// pixels, row by row; and with the number of rays that they took.
using TileDone = std::function<void(const Tile &tile, const Sums &sums, std::uint64_t rays)>;

// Takes the job's samples. `done` may be called from several threads at a time. If the job is cancelled,
// tiles that are not finished are left out.
Report render(const Scene &scene, const Output &output, const Job &job, Progress &progress,
              const TileDone &done);

// The rays of a job, one list per tile; and the time in seconds that Embree takes for them.
using Recording = std::vector<std::vector<RecordedRay>>;
Recording record(const Scene &scene, const Output &output, const Job &job);
double replay_seconds(const Scene &scene, const Recording &recording, int threads);

} // namespace lajolla
