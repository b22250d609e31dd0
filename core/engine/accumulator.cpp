#include "engine/accumulator.h"

#include <algorithm>
#include <stdexcept>

#include "engine/renderable.h"

namespace lajolla {

namespace {

std::size_t tiles_along(int pixels) { return (static_cast<std::size_t>(pixels) + tile_size - 1) / tile_size; }

} // namespace

Accumulator::Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed,
                         std::uint32_t first_sample, std::optional<TileRows> rows)
    : scene_(scene), progress_(std::make_unique<Progress>()), seed_(seed.value_or(scene.seed)),
      first_sample_(first_sample), rows_(rows.value_or(TileRows{0, tiles_along(film().crop_height)})) {
    if (rows_.first >= rows_.end || rows_.end > tiles_along(film().crop_height))
        throw std::invalid_argument("the picture does not have these rows of tiles");
    state_.sums = Sums(width() * height() * channels());
    state_.counts.resize(tile_columns() * tile_rows());
}

Accumulator::~Accumulator() = default;

bool Accumulator::advance(std::uint32_t samples, int threads, bool one_lane) {
    const std::vector<HalfCounts> all(tile_columns() * tile_rows(), {samples, samples});
    return advance(all, threads, one_lane);
}

bool Accumulator::advance(std::span<const HalfCounts> samples, int threads, bool one_lane) {
    const std::lock_guard one_at_a_time(advancing_);
    const auto tiles = tiles_of(film());
    std::vector<HalfCounts> targets = get(&RenderState::counts);
    if (samples.size() != targets.size())
        throw std::invalid_argument("there must be two counts for each tile");
    const std::size_t first = rows_.first * tile_columns();
    Job job{scene_.sequence, seed_, std::vector<std::array<SampleRange, 2>>(tiles.size()), threads, one_lane};
    std::uint64_t to_take = 0;
    for (std::size_t i = 0; i < targets.size(); ++i) {
        auto &ranges = job.ranges[first + i];
        for (std::size_t half = 0; half < 2; ++half) {
            const std::uint32_t before = targets[i][half];
            targets[i][half] = std::max(before, samples[i][half]);
            ranges[half] = {first_sample_ + before, first_sample_ + targets[i][half]};
        }
        to_take += sample_count(film(), tiles[first + i], ranges);
    }
    samples_to_take_ = std::max<std::uint64_t>(to_take, 1);
    progress_->samples = 0;
    const Report report = render(*scene_.scene, scene_.output, job, *progress_,
                                 [&](std::size_t i, const Tile &tile, const Sums &sums) {
                                     add_tile(i - first, tile, sums, targets[i - first]);
                                 });
    NonfiniteList list;
    for (const SampleId &id : report.nonfinite_samples) list.emplace_back(id.x, id.y, id.index);
    const std::lock_guard lock(results_);
    add_report(report.rays, report.nonfinite, list);
    return !progress_->cancelled.exchange(false);
}

void Accumulator::add_report(std::uint64_t rays, std::uint64_t nonfinite, const NonfiniteList &list) {
    state_.rays += rays;
    state_.nonfinite += nonfinite;
    for (const auto &sample : list)
        if (state_.nonfinite_list.size() < Report::kept_samples) state_.nonfinite_list.push_back(sample);
}

void Accumulator::add_tile(std::size_t index, const Tile &tile, const Sums &sums, const HalfCounts &counts) {
    const std::lock_guard lock(results_);
    const std::size_t row = channels() * static_cast<std::size_t>(tile.x1 - tile.x0);
    std::size_t from = 0;
    for (int y = tile.y0; y < tile.y1; ++y, from += row) {
        const std::size_t pixel = (static_cast<std::size_t>(y) - rows_.first * tile_size) * width() +
                                  static_cast<std::size_t>(tile.x0);
        state_.sums.add(channels() * pixel, sums, from, row);
    }
    state_.counts[index] = counts;
}

void Accumulator::cancel() { progress_->cancelled = true; }

double Accumulator::progress() const {
    return static_cast<double>(progress_->samples) / static_cast<double>(samples_to_take_);
}

const Film &Accumulator::film() const { return scene_.scene->film(); }
std::size_t Accumulator::width() const { return static_cast<std::size_t>(film().crop_width); }
std::size_t Accumulator::height() const {
    const auto pixels = static_cast<std::size_t>(film().crop_height);
    return std::min(rows_.end * tile_size, pixels) - rows_.first * tile_size;
}
std::size_t Accumulator::channels() const { return scene_.output.channel_count(); }
std::size_t Accumulator::tile_columns() const { return tiles_along(film().crop_width); }
std::size_t Accumulator::tile_rows() const { return rows_.end - rows_.first; }

std::vector<float> Accumulator::image() const {
    const std::lock_guard lock(results_);
    return means(state_.sums, channels(), counts_of_pixels());
}

std::vector<std::uint32_t> Accumulator::pixel_counts() const {
    const std::lock_guard lock(results_);
    return counts_of_pixels();
}

std::vector<std::uint32_t> Accumulator::counts_of_pixels() const {
    const auto left = static_cast<std::uint32_t>(film().crop_offset_x);
    const auto top =
        static_cast<std::uint32_t>(film().crop_offset_y + static_cast<int>(rows_.first) * tile_size);
    std::vector<std::uint32_t> result;
    result.reserve(width() * height());
    for (std::uint32_t y = 0; y < height(); ++y)
        for (std::uint32_t x = 0; x < width(); ++x) {
            const HalfCounts &tile = state_.counts[y / tile_size * tile_columns() + x / tile_size];
            result.push_back(tile[half_of(left + x, top + y)]);
        }
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
    if (state.sums.size() != state_.sums.size() || state.counts.size() != state_.counts.size())
        throw std::invalid_argument("the samples are of a picture of another size");
    state_ = std::move(state);
}

void Accumulator::add(const RenderState &part, std::size_t first_tile_row) {
    const std::lock_guard one_at_a_time(advancing_);
    const std::lock_guard lock(results_);
    const std::size_t rows = part.counts.size() / tile_columns(), pixels = width() * channels();
    const std::size_t first = first_tile_row * tile_size, end = std::min(first + rows * tile_size, height());
    if (part.counts.size() % tile_columns() != 0 || first_tile_row + rows > tile_rows() ||
        part.sums.size() != (end - first) * pixels)
        throw std::invalid_argument("the samples are of a picture of another size");
    state_.sums.add(first * pixels, part.sums, 0, part.sums.size());
    for (std::size_t i = 0; i < part.counts.size(); ++i)
        for (std::size_t half = 0; half < 2; ++half)
            state_.counts[first_tile_row * tile_columns() + i][half] += part.counts[i][half];
    add_report(part.rays, part.nonfinite, part.nonfinite_list);
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
