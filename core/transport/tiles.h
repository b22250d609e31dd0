#pragma once
// Tiles of the picture, and the loop over them on many threads.

#include <algorithm>
#include <vector>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#if defined(__SSE__)
#include <immintrin.h>
#endif

namespace lajolla {

inline constexpr int tile_size = 16;

// Denormal numbers cost hundreds of cycles and no picture shows them.
class FlushToZero {
public:
#if defined(__SSE__)
    FlushToZero() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040); } // flush-to-zero, denormals-are-zero
    ~FlushToZero() { _mm_setcsr(saved_); }
    FlushToZero(const FlushToZero &) = delete;
    FlushToZero &operator=(const FlushToZero &) = delete;

private:
    unsigned saved_;
#endif
};

struct Tile {
    int x0, y0, x1, y1; // within the crop window
};

// The tiles of rows `first` to `end` - 1.
inline std::vector<Tile> tiles_of(int width, int end, int first = 0) {
    std::vector<Tile> tiles;
    for (int y = first; y < end; y += tile_size)
        for (int x = 0; x < width; x += tile_size)
            tiles.push_back({x, y, std::min(x + tile_size, width), std::min(y + tile_size, end)});
    return tiles;
}

// Calls f(tile index, tile) for all tiles on the given number of threads.
template <class F>
void for_each_tile(const std::vector<Tile> &tiles, int threads, F &&f) {
    const auto run = [&] {
        tbb::parallel_for(std::size_t(0), tiles.size(), [&](std::size_t i) {
            const FlushToZero guard;
            f(i, tiles[i]);
        });
    };
    if (threads <= 0) return run();
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    tbb::task_arena(threads).execute(run);
}

} // namespace lajolla
