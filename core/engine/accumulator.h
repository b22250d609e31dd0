#pragma once
// A progressive render: adds samples to running sums, from which a picture can be computed at any time.

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <tuple>
#include <vector>

#include "transport/render.h"

namespace lajolla {

struct RenderableScene;

using Counts = PerHalf<std::uint32_t>; // samples of each pixel

// Some rows of the picture's tiles.
struct TileRows {
    std::size_t first, end;
};

// The samples so far.
struct RenderState {
    Sums sums; // the channels of a pixel side by side, row by row
    Counts counts;
    std::vector<std::uint64_t> rays{};      // of each tile, row by row
    std::uint64_t nonfinite = 0;            // they count as black
    std::vector<SampleId> nonfinite_list{}; // the first of them
};

class Accumulator {
public:
    // The scene must outlive this. Default of the seed: that of the scene. Each pixel takes its samples in
    // order, the first one of which is `first_sample`. With `rows`, this is a render of a part of the
    // picture. Throws std::invalid_argument for rows that there are not.
    explicit Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed = std::nullopt,
                         std::uint32_t first_sample = 0, std::optional<TileRows> rows = std::nullopt);

    // Adds samples until every pixel has at least this many: one number, or one for each half of all cells.
    // threads = 0 uses them all; one_lane follows one path after the other, for the same bits. Returns false
    // if cancel() was called meanwhile: tiles that were not finished are then as before. All functions may be
    // called from several threads.
    bool advance(std::uint32_t samples, int threads = 0, bool one_lane = false);
    bool advance(std::span<const std::uint32_t> samples, int threads = 0, bool one_lane = false);
    void cancel();
    void resume();           // withdraws a cancel() that no advance() has noticed
    double progress() const; // finished fraction of the running advance()

    std::size_t width() const, height() const, channels() const;
    std::size_t tile_rows() const, tile_columns() const;

    std::vector<float> image() const; // means, row by row, the channels of a pixel side by side
    std::vector<std::uint32_t> pixel_counts() const; // samples, row by row
    std::uint32_t samples() const;                   // that every pixel has, at least
    RenderState state() const;
    void restore(RenderState state); // throws std::invalid_argument if it is not of this scene
    // Adds the state of a render of some rows of tiles from `first_tile_row` on, whose samples follow those
    // that there are. Its counts are numbers of additional samples. Throws std::invalid_argument if it does
    // not fit.
    void add(const RenderState &part, std::size_t first_tile_row);

    template <class T>
    T get(T RenderState::*member) const {
        const std::lock_guard lock(results_);
        return state_.*member;
    }

private:
    std::vector<std::uint32_t> counts_of_pixels() const; // needs the lock
    void add_tile(Tile tile, const Sums &sums, std::uint64_t rays, const Counts &counts);
    void add_nonfinite(std::uint64_t count, std::span<const SampleId> samples);

    const RenderableScene &scene_;
    Film window_;       // of which the rows of tiles are all
    std::uint32_t top_; // the first of its rows of pixels, within the scene's window
    Progress progress_;
    std::atomic<std::uint64_t> samples_to_take_{1}; // in the running advance()
    std::uint32_t seed_, first_sample_;
    std::mutex advancing_;
    mutable std::mutex results_; // of the state
    RenderState state_;
};

// Means of sums: `counts` is one number for each pixel, which has `channels` sums.
std::vector<float> means(const Sums &sums, std::size_t channels, std::span<const std::uint32_t> counts);

} // namespace lajolla
