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

// Adds the samples of one tile to its sums.
class TileAccumulator {
public:
    TileAccumulator(const Scene &scene, const Output &output, const Tile &tile, Tracer &tracer,
                    Report &report)
        : scene_(scene), recorder_(output), tracer_(tracer), report_(report),
          channels_(output.channel_count()),
          left_(static_cast<std::uint32_t>(scene.film().crop_offset_x + tile.x0)),
          top_(static_cast<std::uint32_t>(scene.film().crop_offset_y + tile.y0)),
          width_(static_cast<std::size_t>(tile.x1 - tile.x0)),
          sums_(channels_ * width_ * static_cast<std::size_t>(tile.y1 - tile.y0)) {}

    const Sums &sums() const { return sums_; }

    // `value` is what the picture's integrator found, and `groups` the same by light groups; the channels
    // beside it are recorded here.
    void add(const SampleId &id, const Sampler &sampler, PrimaryRay &primary, const Spectrum &value,
             std::span<const Spectrum> groups, float weight) {
        add(id, value, weight, recorder_.record(scene_, sampler, primary, value, groups, weight, tracer_));
    }
    void add(const SampleId &id, const Spectrum &value, float weight, std::span<const float> rest = {}) {
        const auto holds = [&](float v) { return std::isfinite(v * weight); };
        if (!is_finite(value * weight) || !std::ranges::all_of(rest, holds)) [[unlikely]] {
            ++report_.nonfinite;
            if (report_.nonfinite_samples.size() < Report::kept_samples)
                report_.nonfinite_samples.push_back(id);
            return;
        }
        const std::size_t first = channels_ * ((id.y - top_) * width_ + (id.x - left_));
        sums_.add(first, value.x * weight);
        sums_.add(first + 1, value.y * weight);
        sums_.add(first + 2, value.z * weight);
        for (std::size_t c = 0; c < rest.size(); ++c) sums_.add(first + 3 + c, rest[c] * weight);
    }

private:
    const Scene &scene_;
    ChannelRecorder recorder_;
    Tracer &tracer_;
    Report &report_;
    std::size_t channels_;
    std::uint32_t left_, top_;
    std::size_t width_;
    Sums sums_;
};

// The samples of a tile in order: all of a pixel, then those of the next.
class TileSamples {
public:
    TileSamples(const Film &film, const Tile &tile, const SampleRanges &ranges)
        : ranges_(ranges), left_x_(static_cast<std::uint32_t>(tile.x0)),
          right_x_(static_cast<std::uint32_t>(tile.x1)), x_(left_x_), y_(static_cast<std::uint32_t>(tile.y0)),
          offset_x_(static_cast<std::uint32_t>(film.crop_offset_x)),
          offset_y_(static_cast<std::uint32_t>(film.crop_offset_y)), range_(ranges.at(x_, y_)),
          left_(sample_count(tile, ranges)) {}

    std::uint64_t left() const { return left_; }
    SampleId take() {
        while (range_.size() == 0) {
            if (++x_ == right_x_) x_ = left_x_, ++y_;
            range_ = ranges_.at(x_, y_);
        }
        --left_;
        return {offset_x_ + x_, offset_y_ + y_, range_.first++};
    }

private:
    const SampleRanges &ranges_;
    std::uint32_t left_x_, right_x_;
    std::uint32_t x_, y_; // the current pixel, within the crop window
    std::uint32_t offset_x_, offset_y_;
    SampleRange range_; // of the current pixel, without those that were taken
    std::uint64_t left_;
};

// For the radiance of one sample by light groups; empty if no channel needs it.
std::vector<Spectrum> group_sums(const Scene &scene, const Output &output) {
    return std::vector<Spectrum>(output.has_light_groups() ? scene.light_group_count() : 0);
}

// Depth first, one path after the other. Stops where the job is cancelled.
template <class Model>
void render_one_by_one(const Scene &scene, const Model &integrator, const Output &output,
                       TileSamples &samples, const Job &job, Progress &progress, Tracer &tracer,
                       TileAccumulator &sums) {
    std::vector<Spectrum> groups = group_sums(scene, output);
    while (samples.left() > 0) {
        if (progress.cancelled.load(std::memory_order_relaxed)) return;
        const SampleId id = samples.take();
        const Sampler sampler(job.sequence, job.seed, id.x, id.y, id.index);
        const auto [camera, weight] = film_sample(scene, sampler, id);
        PrimaryRay primary(tracer, camera, footprint_of(output.integrator));
        std::ranges::fill(groups, Spectrum(0));
        const LightGroups by_group(scene, groups);
        const auto radiance = [&] {
            if constexpr (requires { integrator.radiance(scene, tracer, sampler, primary, by_group); })
                return integrator.radiance(scene, tracer, sampler, primary, by_group);
            else return integrator.radiance(scene, tracer, sampler, primary);
        };
        sums.add(id, sampler, primary, radiance(), groups, weight);
        progress.samples.fetch_add(1, std::memory_order_relaxed);
    }
}

// Many at a time.
void render_in_lanes(const Scene &scene, Wavefront &wavefront, const Output &output, TileSamples &samples,
                     const Job &job, Progress &progress, Tracer &tracer, TileAccumulator &sums) {
    const auto most =
        static_cast<std::size_t>(std::min<std::uint64_t>(samples.left(), Wavefront::most_samples));
    const std::size_t group_count = group_sums(scene, output).size();
    std::vector<SampleId> ids(most);
    std::vector<Spectrum> radiance(most), groups(group_count * most);
    std::vector<float> weights(most);
    while (samples.left() > 0) {
        if (progress.cancelled.load(std::memory_order_relaxed)) return;
        const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(samples.left(), most));
        for (std::size_t i = 0; i < count; ++i) ids[i] = samples.take();
        wavefront.render(std::span(ids).first(count), job.sequence, job.seed, tracer, radiance, weights,
                         groups);
        for (std::size_t i = 0; i < count; ++i) {
            if (output.channels.empty()) {
                sums.add(ids[i], radiance[i], weights[i]);
                continue;
            }
            const Sampler sampler(job.sequence, job.seed, ids[i].x, ids[i].y, ids[i].index);
            const CameraRay<float> camera = film_sample(scene, sampler, ids[i]).camera;
            PrimaryRay primary(tracer, camera, footprint_of(output.integrator));
            sums.add(ids[i], sampler, primary, radiance[i],
                     std::span(groups).subspan(group_count * i, group_count), weights[i]);
        }
        progress.samples.fetch_add(count, std::memory_order_relaxed);
    }
}

// Renders all tiles; their rays go to `recording` if there is one.
std::vector<Report> render_tiles(const Scene &scene, const Output &output, const Job &job, Progress &progress,
                                 const TileDone &done, Recording *recording) {
    const auto tiles = tiles_of(scene.film());
    std::vector<Report> reports(tiles.size());
    if (recording) recording->resize(tiles.size());
    const auto for_each = [&](auto &&render) {
        for_each_tile(tiles, job.threads, [&](std::size_t i, const Tile &tile) {
            TileSamples samples(scene.film(), tile, job.ranges);
            if (samples.left() == 0) return;
            Report report;
            Tracer tracer(scene.accel(), recording ? &(*recording)[i] : nullptr);
            TileAccumulator accumulator(scene, output, tile, tracer, report);
            render(samples, tracer, accumulator);
            if (samples.left() > 0) return; // cancelled
            reports[i] = report;
            done(tile, accumulator.sums(), tracer.rays());
        });
    };
    match(output.integrator, [&](const auto &model) {
        if constexpr (std::is_base_of_v<Path, std::decay_t<decltype(model)>>)
            if (!job.one_lane && model.is_vacuum(scene)) {
                tbb::enumerable_thread_specific<Wavefront> wavefronts(
                    [&] { return Wavefront(scene, model); });
                return for_each([&](TileSamples &samples, Tracer &tracer, TileAccumulator &accumulator) {
                    render_in_lanes(scene, wavefronts.local(), output, samples, job, progress, tracer,
                                    accumulator);
                });
            }
        for_each([&](TileSamples &samples, Tracer &tracer, TileAccumulator &accumulator) {
            render_one_by_one(scene, model, output, samples, job, progress, tracer, accumulator);
        });
    });
    return reports;
}

Report merged(const std::vector<Report> &reports) {
    Report result;
    for (const Report &report : reports) {
        result.nonfinite += report.nonfinite;
        for (const SampleId &id : report.nonfinite_samples)
            if (result.nonfinite_samples.size() < Report::kept_samples)
                result.nonfinite_samples.push_back(id);
    }
    return result;
}

} // namespace

std::vector<Tile> tiles_of(const Film &film) { return tiles_of(film, 0, film.crop_height); }

std::vector<Tile> tiles_of(const Film &film, int first_row, int end_row) {
    std::vector<Tile> tiles;
    for (int y = first_row; y < end_row; y += tile_size)
        for (int x = 0; x < film.crop_width; x += tile_size)
            tiles.push_back(
                {x, y, std::min(x + tile_size, film.crop_width), std::min(y + tile_size, end_row)});
    return tiles;
}

std::uint64_t sample_count(const Tile &tile, const SampleRanges &ranges) {
    std::uint64_t result = 0;
    for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x)
            result += ranges.at(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)).size();
    return result;
}

Spectrum sample_radiance(const Scene &scene, const Integrator &integrator, SequenceKind sequence,
                         std::uint32_t seed, SampleId id, Tracer &tracer) {
    const FlushToZero guard;
    const Sampler sampler(sequence, seed, id.x, id.y, id.index);
    const auto [camera, weight] = film_sample(scene, sampler, id);
    PrimaryRay primary(tracer, camera, footprint_of(integrator));
    return weight * match(integrator,
                          [&](const auto &model) { return model.radiance(scene, tracer, sampler, primary); });
}

Report render(const Scene &scene, const Output &output, const Job &job, Progress &progress,
              const TileDone &done) {
    return merged(render_tiles(scene, output, job, progress, done, nullptr));
}

Recording record(const Scene &scene, const Output &output, const Job &job) {
    Progress progress;
    Recording recording;
    render_tiles(
        scene, output, job, progress, [](const Tile &, const Sums &, std::uint64_t) {}, &recording);
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
