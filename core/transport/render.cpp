#include "transport/render.h"

#include <algorithm>
#include <chrono>

#include <tbb/enumerable_thread_specific.h>

#include "transport/tiles.h"
#include "transport/wavefront.h"

namespace lajolla {

namespace {

FilmSample<float> film_sample(const Scene &scene, const Sampler &sampler, const SampleId &id) {
    return sample_film(scene, sampler.camera(), static_cast<float>(id.x), static_cast<float>(id.y));
}

// Takes the samples of one tile, pixel by pixel, and adds them to the sums.
class TileAccumulator {
public:
    TileAccumulator(const Scene &scene, const Output &output, std::span<double> sums, Tracer &tracer,
                    Report &report)
        : scene_(scene), output_(output), recorder_(output), sums_(sums), tracer_(tracer), report_(report) {}

    // `value` is what the picture's integrator found; the channels beside it are recorded here.
    void add(const SampleId &id, const Sampler &sampler, PrimaryRay &primary, const Spectrum &value,
             float weight) {
        add(id, value, weight, recorder_.record(scene_, sampler, primary, value, weight, tracer_));
    }
    void add(const SampleId &id, const Spectrum &value, float weight, std::span<const float> rest = {}) {
        if (!is_finite(value) || !std::ranges::all_of(rest, [](float v) { return std::isfinite(v); }))
            [[unlikely]] {
            ++report_.nonfinite;
            if (report_.nonfinite_samples.size() < Report::kept_samples)
                report_.nonfinite_samples.push_back(id);
            return;
        }
        const Film &film = scene_.film();
        const std::size_t x = id.x - static_cast<std::uint32_t>(film.crop_offset_x),
                          y = id.y - static_cast<std::uint32_t>(film.crop_offset_y);
        double *sum = &sums_[output_.channel_count() * (y * static_cast<std::size_t>(film.crop_width) + x)];
        sum[0] += value.x * weight, sum[1] += value.y * weight, sum[2] += value.z * weight;
        for (std::size_t c = 0; c < rest.size(); ++c) sum[3 + c] += rest[c] * weight;
    }

private:
    const Scene &scene_;
    const Output &output_;
    ChannelRecorder recorder_;
    std::span<double> sums_;
    Tracer &tracer_;
    Report &report_;
};

// The samples of a tile in order: all of a pixel, then those of the next.
class TileSamples {
public:
    TileSamples(const Film &film, const Tile &tile, const Job &job)
        : left_(static_cast<std::uint32_t>(film.crop_offset_x + tile.x0)),
          right_(static_cast<std::uint32_t>(film.crop_offset_x + tile.x1)), first_(job.first),
          end_(job.first + job.count), count_(static_cast<std::uint64_t>(tile.x1 - tile.x0) *
                                              static_cast<std::uint64_t>(tile.y1 - tile.y0) * job.count),
          next_{left_, static_cast<std::uint32_t>(film.crop_offset_y + tile.y0), job.first} {}

    std::uint64_t left() const { return count_; }
    SampleId take() {
        const SampleId result = next_;
        --count_;
        if (++next_.index == end_) {
            next_.index = first_;
            if (++next_.x == right_) next_.x = left_, ++next_.y;
        }
        return result;
    }
    // Whether the sample after which take() was called last is the last of its pixel.
    bool pixel_is_done() const { return next_.index == first_; }

private:
    std::uint32_t left_, right_, first_, end_;
    std::uint64_t count_;
    SampleId next_;
};

// Depth first, one path after the other. Stops where the job is cancelled.
template <class Model>
void render_one_by_one(const Scene &scene, const Model &integrator, TileSamples &samples, const Job &job,
                       Progress &progress, Tracer &tracer, TileAccumulator &sums) {
    while (samples.left() > 0) {
        if (progress.cancelled.load(std::memory_order_relaxed)) return;
        const SampleId id = samples.take();
        const Sampler sampler(job.sequence, job.seed, id.x, id.y, id.index);
        const auto [camera, weight] = film_sample(scene, sampler, id);
        PrimaryRay primary(scene, tracer, camera);
        sums.add(id, sampler, primary, integrator.radiance(scene, tracer, sampler, primary), weight);
        if (samples.pixel_is_done()) progress.pixels.fetch_add(1, std::memory_order_relaxed);
    }
}

// Many at a time.
void render_in_lanes(const Scene &scene, Wavefront &wavefront, const Output &output, TileSamples &samples,
                     const Job &job, Progress &progress, Tracer &tracer, TileAccumulator &sums) {
    std::array<SampleId, Wavefront::capacity> ids;
    std::array<Spectrum, Wavefront::capacity> radiance;
    std::array<float, Wavefront::capacity> weights;
    while (samples.left() > 0) {
        if (progress.cancelled.load(std::memory_order_relaxed)) return;
        const auto count =
            static_cast<std::size_t>(std::min<std::uint64_t>(samples.left(), Wavefront::capacity));
        std::uint64_t pixels = 0;
        for (std::size_t i = 0; i < count; ++i) {
            ids[i] = samples.take();
            pixels += samples.pixel_is_done();
        }
        wavefront.render(std::span(ids).first(count), job.sequence, job.seed, tracer, radiance, weights);
        for (std::size_t i = 0; i < count; ++i) {
            if (output.channels.empty()) {
                sums.add(ids[i], radiance[i], weights[i]);
                continue;
            }
            const Sampler sampler(job.sequence, job.seed, ids[i].x, ids[i].y, ids[i].index);
            const CameraRay<float> camera = film_sample(scene, sampler, ids[i]).camera;
            PrimaryRay primary(scene, tracer, camera);
            sums.add(ids[i], sampler, primary, radiance[i], weights[i]);
        }
        progress.pixels.fetch_add(pixels, std::memory_order_relaxed);
    }
}

// Renders all tiles; their rays go to `recording` where there is one.
std::vector<Report> render_tiles(const Scene &scene, const Output &output, const Job &job,
                                 std::span<double> sums, Progress &progress, Recording *recording) {
    const auto tiles = tiles_of(scene.film().crop_width, scene.film().crop_height);
    std::vector<Report> reports(tiles.size());
    if (recording) recording->resize(tiles.size());
    const auto tile_with = [&](std::size_t i, auto &&render) {
        Tracer tracer(scene.accel(), recording ? &(*recording)[i] : nullptr);
        TileAccumulator accumulator(scene, output, sums, tracer, reports[i]);
        render(TileSamples(scene.film(), tiles[i], job), tracer, accumulator);
        reports[i].rays = tracer.rays();
    };
    match(output.integrator, [&](const auto &model) {
        if constexpr (std::is_base_of_v<Path, std::decay_t<decltype(model)>>)
            if (!job.one_lane && model.is_vacuum(scene)) {
                tbb::enumerable_thread_specific<Wavefront> wavefronts(
                    [&] { return Wavefront(scene, model); });
                return for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &) {
                    tile_with(i, [&](TileSamples samples, Tracer &tracer, TileAccumulator &accumulator) {
                        render_in_lanes(scene, wavefronts.local(), output, samples, job, progress, tracer,
                                        accumulator);
                    });
                });
            }
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &) {
            tile_with(i, [&](TileSamples samples, Tracer &tracer, TileAccumulator &accumulator) {
                render_one_by_one(scene, model, samples, job, progress, tracer, accumulator);
            });
        });
    });
    return reports;
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
    const auto [camera, weight] = film_sample(scene, sampler, id);
    PrimaryRay primary(scene, tracer, camera);
    return weight * match(integrator,
                          [&](const auto &model) { return model.radiance(scene, tracer, sampler, primary); });
}

std::optional<Report> render(const Scene &scene, const Output &output, const Job &job, std::span<double> sums,
                             Progress &progress) {
    const auto reports = render_tiles(scene, output, job, sums, progress, nullptr);
    if (progress.cancelled) return std::nullopt;
    return merged(reports);
}

Recording record(const Scene &scene, const Output &output, const Job &job) {
    std::vector<double> sums(output.channel_count() * static_cast<std::size_t>(scene.film().crop_width) *
                             static_cast<std::size_t>(scene.film().crop_height));
    Progress progress;
    Recording recording;
    render_tiles(scene, output, job, sums, progress, &recording);
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
