#include "engine/accumulator.h"

#include <algorithm>
#include <stdexcept>

#include "engine/renderable.h"

namespace lajolla {

namespace {

Film window_of(Film film, const std::optional<TileRows> &rows) {
    if (!rows) return film;
    const auto height = static_cast<std::size_t>(film.crop_height), first = rows->first * tile_size;
    if (rows->first >= rows->end || (rows->end - 1) * tile_size >= height)
        throw std::invalid_argument("the picture does not have these rows of tiles");
    film.crop_offset_y += static_cast<int>(first);
    film.crop_height = static_cast<int>(std::min(rows->end * tile_size, height) - first);
    return film;
}

} // namespace

Accumulator::Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed,
                         std::uint32_t first_sample, std::optional<TileRows> rows)
    : scene_(scene), window_(window_of(scene.scene->film(), rows)),
      top_(static_cast<std::uint32_t>(window_.crop_offset_y - scene.scene->film().crop_offset_y)),
      seed_(seed.value_or(scene.seed)), first_sample_(first_sample),
      state_{Sums(width() * height() * channels()), Counts(window_),
             std::vector<std::uint64_t>(tile_rows() * tile_columns())} {}

bool Accumulator::advance(std::uint32_t samples, int threads, bool one_lane) {
    const std::vector<std::uint32_t> all(get(&RenderState::counts).values().size(), samples);
    return advance(all, threads, one_lane);
}

bool Accumulator::advance(std::span<const std::uint32_t> samples, int threads, bool one_lane) {
    const std::lock_guard one_at_a_time(advancing_);
    const Film &film = scene_.scene->film();
    Counts targets = get(&RenderState::counts);
    if (samples.size() != targets.values().size())
        throw std::invalid_argument("samples must have the shape of counts");
    Job job{scene_.sequence, seed_, SampleRanges(film), threads, one_lane};
    const auto ranges = job.ranges.values().subspan(2 * targets.columns() * (top_ / cell_size));
    for (std::size_t i = 0; i < samples.size(); ++i) {
        std::uint32_t &target = targets.values()[i];
        ranges[i].first = first_sample_ + target;
        target = std::max(target, samples[i]);
        ranges[i].end = first_sample_ + target;
    }
    samples_to_take_ =
        std::max<std::uint64_t>(1, sample_count({0, 0, film.crop_width, film.crop_height}, job.ranges));
    progress_.samples = 0;
    const Report report = render(
        *scene_.scene, scene_.output, job, progress_,
        [&](const Tile &tile, const Sums &sums, std::uint64_t rays) { add_tile(tile, sums, rays, targets); });
    const std::lock_guard lock(results_);
    add_nonfinite(report.nonfinite, report.nonfinite_samples);
    return !progress_.cancelled.exchange(false);
}

void Accumulator::add_nonfinite(std::uint64_t count, std::span<const SampleId> samples) {
    state_.nonfinite += count;
    for (const SampleId &id : samples)
        if (state_.nonfinite_list.size() < Report::kept_samples) state_.nonfinite_list.push_back(id);
}

void Accumulator::add_tile(Tile tile, const Sums &sums, std::uint64_t rays, const Counts &counts) {
    tile.y0 -= static_cast<int>(top_), tile.y1 -= static_cast<int>(top_);
    const std::lock_guard lock(results_);
    const std::size_t row = channels() * static_cast<std::size_t>(tile.x1 - tile.x0);
    std::size_t from = 0;
    for (int y = tile.y0; y < tile.y1; ++y, from += row) {
        const std::size_t pixel = static_cast<std::size_t>(y) * width() + static_cast<std::size_t>(tile.x0);
        state_.sums.add(channels() * pixel, sums, from, row);
    }
    for (std::uint32_t y = static_cast<std::uint32_t>(tile.y0); y < static_cast<std::uint32_t>(tile.y1);
         y += cell_size)
        for (std::uint32_t x = static_cast<std::uint32_t>(tile.x0); x < static_cast<std::uint32_t>(tile.x1);
             x += cell_size)
            for (const std::uint32_t half : {0u, 1u}) state_.counts.at(x + half, y) = counts.at(x + half, y);
    state_.rays[static_cast<std::size_t>(tile.y0) / tile_size * tile_columns() +
                static_cast<std::size_t>(tile.x0) / tile_size] += rays;
}

void Accumulator::cancel() { progress_.cancelled = true; }

void Accumulator::resume() { progress_.cancelled = false; }

double Accumulator::progress() const {
    return static_cast<double>(progress_.samples) / static_cast<double>(samples_to_take_);
}

std::size_t Accumulator::width() const { return static_cast<std::size_t>(window_.crop_width); }
std::size_t Accumulator::height() const { return static_cast<std::size_t>(window_.crop_height); }
std::size_t Accumulator::channels() const { return scene_.output.channel_count(); }
std::size_t Accumulator::tile_rows() const { return (height() + tile_size - 1) / tile_size; }
std::size_t Accumulator::tile_columns() const { return (width() + tile_size - 1) / tile_size; }

std::vector<float> Accumulator::image() const {
    const std::lock_guard lock(results_);
    return means(state_.sums, channels(), counts_of_pixels());
}

std::vector<std::uint32_t> Accumulator::pixel_counts() const {
    const std::lock_guard lock(results_);
    return counts_of_pixels();
}

std::vector<std::uint32_t> Accumulator::counts_of_pixels() const {
    std::vector<std::uint32_t> result;
    result.reserve(width() * height());
    for (std::uint32_t y = 0; y < height(); ++y)
        for (std::uint32_t x = 0; x < width(); ++x) result.push_back(state_.counts.at(x, y));
    return result;
}

std::uint32_t Accumulator::samples() const {
    const auto counts = pixel_counts();
    return *std::ranges::min_element(counts);
}

RenderState Accumulator::state() const {
    const std::lock_guard lock(results_);
    return state_;
}

void Accumulator::restore(RenderState state) {
    const std::lock_guard one_at_a_time(advancing_);
    const std::lock_guard lock(results_);
    if (state.sums.size() != state_.sums.size() || state.rays.size() != state_.rays.size())
        throw std::invalid_argument("the samples are of a picture of another size");
    state_ = std::move(state);
}

void Accumulator::add(const RenderState &part, std::size_t first_tile_row) {
    const std::lock_guard one_at_a_time(advancing_);
    const std::lock_guard lock(results_);
    const std::size_t first = first_tile_row * tile_size, row = width() * channels();
    const std::size_t first_count = 2 * state_.counts.columns() * (first / cell_size);
    const std::size_t first_tile = first_tile_row * tile_columns();
    const auto counts = state_.counts.values();
    if (first * row + part.sums.size() > state_.sums.size() ||
        part.counts.columns() != state_.counts.columns() ||
        first_count + part.counts.values().size() > counts.size() ||
        part.rays.size() != tile_columns() * ((part.sums.size() / row + tile_size - 1) / tile_size) ||
        first_tile + part.rays.size() > state_.rays.size())
        throw std::invalid_argument("the samples are of a picture of another size");
    state_.sums.add(first * row, part.sums, 0, part.sums.size());
    for (std::size_t i = 0; i < part.counts.values().size(); ++i)
        counts[first_count + i] += part.counts.values()[i];
    for (std::size_t i = 0; i < part.rays.size(); ++i) state_.rays[first_tile + i] += part.rays[i];
    add_nonfinite(part.nonfinite, part.nonfinite_list);
}

std::vector<float> means(const Sums &sums, std::size_t channels, std::span<const std::uint32_t> counts) {
    std::vector<float> result(sums.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
        const std::uint32_t count = counts[i / channels];
        result[i] = count > 0 ? static_cast<float>(sums.value(i) / count) : 0.0f;
    }
    return result;
}

} // namespace lajolla
