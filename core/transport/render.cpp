#include "transport/render.h"

#include <algorithm>
#include <chrono>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#if defined(__SSE__)
#include <immintrin.h>
#endif

#include "transport/coverage.h"

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

// A camera ray, and what its place under the pixel filter counts.
struct FilmSample {
    CameraRay camera;
    float weight;
};

FilmSample sample_film(const Scene &scene, const Sampler &sampler, SampleId id) {
    const Film &film = scene.film();
    const CameraSample u = sampler.camera();
    const auto offset = scene.filter().sample(u.film);
    const Vec2f position{(static_cast<float>(id.x) + 0.5f + offset.offset.x) / static_cast<float>(film.width),
                         (static_cast<float>(id.y) + 0.5f + offset.offset.y) /
                             static_cast<float>(film.height)};
    FilmSample result{scene.camera_ray(position, u.lens), offset.weight};
    result.camera.flight = u.flight;
    result.camera.channel = u.channel;
    result.camera.film = position;
    result.camera.lens = u.lens;
    return result;
}

// Linear sRGB to CIE XYZ (IEC 61966-2-1).
Spectrum to_xyz(Spectrum c) {
    return {0.412453f * c.x + 0.357580f * c.y + 0.180423f * c.z, luminance(c),
            0.019334f * c.x + 0.119193f * c.y + 0.950227f * c.z};
}

// The alpha of what an integrator shows: those that show surfaces instead of light look through nothing.
float alpha(const Scene &scene, const Integrator &integrator, const Sampler &sampler, const CameraRay &camera,
            Tracer &tracer) {
    return match(integrator, [&](const auto &model) {
        if constexpr (requires { model.version; })
            if (!scene.media().empty())
                return coverage(scene, tracer, camera, model.hide_emitters,
                                InMedia(scene, camera, sampler, model.version > 1));
        if constexpr (requires { model.hide_emitters; })
            return coverage(scene, tracer, camera, model.hide_emitters, Vacuum());
        else return tracer.closest(camera.ray) ? 1.0f : 0.0f;
    });
}

// The channels beside the picture's own, of one sample after the other.
class ChannelRecorder {
public:
    explicit ChannelRecorder(const Output &output)
        : output_(output), colours_(1 + output.others.size()), values_(output.channels.size()) {}

    // `picture` is what the picture's integrator found along the camera ray.
    std::span<const float> record(const Scene &scene, const Sampler &sampler, const CameraRay &camera,
                                  Spectrum picture, Tracer &tracer) {
        colours_[0] = picture;
        for (std::size_t i = 0; i < output_.others.size(); ++i)
            colours_[i + 1] = match(output_.others[i], [&](const auto &model) {
                return model.radiance(scene, tracer, sampler, camera);
            });
        for (std::size_t i = 0; i < values_.size(); ++i) {
            const Channel &channel = output_.channels[i];
            const float value = channel.recorded == Recorded::alpha
                                    ? alpha(scene, integrator(channel), sampler, camera, tracer)
                                    : colour_value(channel);
            values_[i] = channel.squared ? sqr(value) : value;
        }
        return values_;
    }

private:
    const Integrator &integrator(const Channel &channel) const {
        return channel.source == 0 ? output_.integrator
                                   : output_.others[static_cast<std::size_t>(channel.source) - 1];
    }
    float colour_value(const Channel &channel) const {
        if (channel.recorded == Recorded::one) return 1;
        const Spectrum rgb = colours_[static_cast<std::size_t>(channel.source)];
        const Spectrum c = channel.recorded == Recorded::xyz ? to_xyz(rgb) : rgb;
        return channel.component == 0 ? c.x : channel.component == 1 ? c.y : c.z;
    }

    const Output &output_;
    std::vector<Spectrum> colours_; // of every integrator
    std::vector<float> values_;
};

// Renders one tile; false where the job was cancelled meanwhile. `integrator` is the output's.
template <class Model>
bool render_tile(const Scene &scene, const Model &integrator, const Output &output, const Job &job,
                 const Tile &tile, std::span<double> sums, Progress &progress, Tracer &tracer,
                 Report &report) {
    const Film &film = scene.film();
    ChannelRecorder recorder(output);
    for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) {
            const auto pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(film.crop_width) +
                               static_cast<std::size_t>(x);
            double *sum = &sums[output.channel_count() * pixel];
            for (std::uint32_t i = 0; i < job.count; ++i) {
                if (progress.cancelled.load(std::memory_order_relaxed)) return false;
                const SampleId id{static_cast<std::uint32_t>(film.crop_offset_x + x),
                                  static_cast<std::uint32_t>(film.crop_offset_y + y), job.first + i};
                const Sampler sampler(job.sequence, job.seed, id.x, id.y, id.index);
                const auto [camera, weight] = sample_film(scene, sampler, id);
                const Spectrum value = integrator.radiance(scene, tracer, sampler, camera);
                std::span<const float> rest;
                if (!output.channels.empty()) rest = recorder.record(scene, sampler, camera, value, tracer);
                if (!is_finite(value) || !std::ranges::all_of(rest, [](float v) { return std::isfinite(v); }))
                    [[unlikely]] {
                    ++report.nonfinite;
                    if (report.nonfinite_samples.size() < Report::kept_samples)
                        report.nonfinite_samples.push_back(id);
                    continue;
                }
                sum[0] += value.x * weight, sum[1] += value.y * weight, sum[2] += value.z * weight;
                for (std::size_t c = 0; c < rest.size(); ++c) sum[3 + c] += rest[c] * weight;
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
    const auto [camera, weight] = sample_film(scene, sampler, id);
    return weight * match(integrator,
                          [&](const auto &model) { return model.radiance(scene, tracer, sampler, camera); });
}

std::optional<Report> render(const Scene &scene, const Output &output, const Job &job, std::span<double> sums,
                             Progress &progress) {
    const auto tiles = tiles_of(scene.film());
    std::vector<Report> reports(tiles.size());
    match(output.integrator, [&](const auto &model) {
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &tile) {
            Tracer tracer(scene.accel());
            render_tile(scene, model, output, job, tile, sums, progress, tracer, reports[i]);
            reports[i].rays = tracer.rays();
        });
    });
    if (progress.cancelled) return std::nullopt;
    return merged(reports);
}

Recording record(const Scene &scene, const Output &output, const Job &job) {
    const auto tiles = tiles_of(scene.film());
    Recording recording(tiles.size());
    std::vector<double> sums(output.channel_count() * static_cast<std::size_t>(scene.film().crop_width) *
                             static_cast<std::size_t>(scene.film().crop_height));
    Progress progress;
    match(output.integrator, [&](const auto &model) {
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &tile) {
            Tracer tracer(scene.accel(), &recording[i]);
            Report report;
            render_tile(scene, model, output, job, tile, sums, progress, tracer, report);
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
