#pragma once
// The loop over tiles on many threads.

#include <vector>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#if defined(__SSE__)
#include <immintrin.h>
#endif

#include "transport/render.h"

namespace lajolla {

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

// Calls f(index) for all indices below `count` on the given number of threads; 0: on all.
template <class F>
void for_each_index(std::size_t count, int threads, F &&f) {
    const auto run = [&] {
        tbb::parallel_for(std::size_t(0), count, [&](std::size_t i) {
            const FlushToZero guard;
            f(i);
        });
    };
    if (threads <= 0) return run();
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    tbb::task_arena(threads).execute(run);
}

// Calls f(tile index, tile) for all tiles.
template <class F>
void for_each_tile(const std::vector<Tile> &tiles, int threads, F &&f) {
    for_each_index(tiles.size(), threads, [&](std::size_t i) { f(i, tiles[i]); });
}

} // namespace lajolla
