#include "transport/render.h"

#include <algorithm>
#include <chrono>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#if defined(__SSE__)
#include <immintrin.h>
#endif

namespace lajolla {

namespace {

constexpr int tile_size = 16;

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

std::vector<Tile> tiles_of(const Film &film) {
    std::vector<Tile> tiles;
    for (int y = 0; y < film.crop_height; y += tile_size)
        for (int x = 0; x < film.crop_width; x += tile_size)
            tiles.push_back(
                {x, y, std::min(x + tile_size, film.crop_width), std::min(y + tile_size, film.crop_height)});
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

template <class Model>
Spectrum take_sample(const Scene &scene, const Model &integrator, const Sampler &sampler, SampleId id,
                     Tracer &tracer) {
    const Film &film = scene.film();
    const CameraSample u = sampler.camera();
    const auto offset = scene.filter().sample(u.film);
    const Vec2f position{(static_cast<float>(id.x) + 0.5f + offset.offset.x) / static_cast<float>(film.width),
                         (static_cast<float>(id.y) + 0.5f + offset.offset.y) /
                             static_cast<float>(film.height)};
    CameraRay camera = scene.camera_ray(position, u.lens);
    camera.flight = u.flight;
    camera.channel = u.channel;
    return integrator.radiance(scene, tracer, sampler, camera) * offset.weight;
}

// Renders one tile; false where the job was cancelled meanwhile.
template <class Model>
bool render_tile(const Scene &scene, const Model &integrator, const Job &job, const Tile &tile,
                 std::span<double> sums, Progress &progress, Tracer &tracer, Report &report) {
    const Film &film = scene.film();
    for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) {
            double *sum = &sums[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(film.crop_width) +
                                     static_cast<std::size_t>(x))];
            for (std::uint32_t i = 0; i < job.count; ++i) {
                if (progress.cancelled.load(std::memory_order_relaxed)) return false;
                const SampleId id{static_cast<std::uint32_t>(film.crop_offset_x + x),
                                  static_cast<std::uint32_t>(film.crop_offset_y + y), job.first + i};
                const Sampler sampler(job.sequence, job.seed, id.x, id.y, id.index);
                const Spectrum value = take_sample(scene, integrator, sampler, id, tracer);
                if (!is_finite(value)) [[unlikely]] {
                    ++report.nonfinite;
                    if (report.nonfinite_samples.size() < Report::kept_samples)
                        report.nonfinite_samples.push_back(id);
                    continue;
                }
                sum[0] += value.x, sum[1] += value.y, sum[2] += value.z;
            }
            progress.pixels.fetch_add(1, std::memory_order_relaxed);
        }
    return true;
}

Report merged(const std::vector<Report> &reports) {
    Report result;
    for (const Report &report : reports) {
        result.rays += report.rays;
        result.nonfinite += report.nonfinite;
        for (const SampleId &id : report.nonfinite_samples)
            if (result.nonfinite_samples.size() < Report::kept_samples)
                result.nonfinite_samples.push_back(id);
    }
    return result;
}

} // namespace

Spectrum sample_radiance(const Scene &scene, const Integrator &integrator, SequenceKind sequence,
                         std::uint32_t seed, SampleId id, Tracer &tracer) {
    const FlushToZero guard;
    const Sampler sampler(sequence, seed, id.x, id.y, id.index);
    return match(integrator,
                 [&](const auto &model) { return take_sample(scene, model, sampler, id, tracer); });
}

std::optional<Report> render(const Scene &scene, const Integrator &integrator, const Job &job,
                             std::span<double> sums, Progress &progress) {
    const auto tiles = tiles_of(scene.film());
    std::vector<Report> reports(tiles.size());
    match(integrator, [&](const auto &model) {
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &tile) {
            Tracer tracer(scene.accel());
            render_tile(scene, model, job, tile, sums, progress, tracer, reports[i]);
            reports[i].rays = tracer.rays();
        });
    });
    if (progress.cancelled) return std::nullopt;
    return merged(reports);
}

Recording record(const Scene &scene, const Integrator &integrator, const Job &job) {
    const auto tiles = tiles_of(scene.film());
    Recording recording(tiles.size());
    std::vector<double> sums(3 * static_cast<std::size_t>(scene.film().crop_width) *
                             static_cast<std::size_t>(scene.film().crop_height));
    Progress progress;
    match(integrator, [&](const auto &model) {
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &tile) {
            Tracer tracer(scene.accel(), &recording[i]);
            Report report;
            render_tile(scene, model, job, tile, sums, progress, tracer, report);
        });
    });
    return recording;
}

double replay_seconds(const Scene &scene, const Recording &recording, int threads) {
    const auto start = std::chrono::steady_clock::now();
    std::atomic<std::uint64_t> hits{0}; // so that no query can be left out
    for_each_tile(std::vector<Tile>(recording.size()), threads, [&](std::size_t i, const Tile &) {
        std::uint64_t found = 0;
        for (const auto &[ray, occlusion] : recording[i])
            found += occlusion ? scene.accel().occluded(ray) : scene.accel().closest(ray).has_value();
        hits += found;
    });
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

} // namespace lajolla
