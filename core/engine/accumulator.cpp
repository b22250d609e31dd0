#include "engine/accumulator.h"

#include <algorithm>
#include <stdexcept>

#include "engine/renderable.h"

namespace lajolla {

namespace {

std::size_t tiles_along(std::size_t pixels) { return (pixels + tile_size - 1) / tile_size; }

} // namespace

Accumulator::Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed,
                         std::uint32_t first_sample)
    : scene_(scene), progress_(std::make_unique<Progress>()), seed_(seed.value_or(scene.seed)),
      first_sample_(first_sample) {
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
    const auto tiles = tiles_of(scene_.scene->film());
    if (samples.size() != tiles.size()) throw std::invalid_argument("there must be two counts for each tile");
    Job job{scene_.sequence, seed_, {}, threads, one_lane};
    std::vector<HalfCounts> targets = get(&RenderState::counts);
    std::uint64_t to_take = 0;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
        auto &ranges = job.ranges.emplace_back();
        for (std::size_t half = 0; half < 2; ++half) {
            const std::uint32_t before = targets[i][half];
            targets[i][half] = std::max(before, samples[i][half]);
            ranges[half] = {first_sample_ + before, first_sample_ + targets[i][half]};
        }
        to_take += sample_count(scene_.scene->film(), tiles[i], ranges);
    }
    samples_to_take_ = std::max<std::uint64_t>(to_take, 1);
    progress_->samples = 0;
    const Report report = render(
        *scene_.scene, scene_.output, job, *progress_,
        [&](std::size_t i, const Tile &tile, const Sums &sums) { add_tile(i, tile, sums, targets[i]); });
    const std::lock_guard lock(results_);
    state_.rays += report.rays;
    state_.nonfinite += report.nonfinite;
    for (const SampleId &id : report.nonfinite_samples)
        if (state_.nonfinite_list.size() < Report::kept_samples)
            state_.nonfinite_list.emplace_back(id.x, id.y, id.index);
    return !progress_->cancelled.exchange(false);
}

void Accumulator::add_tile(std::size_t index, const Tile &tile, const Sums &sums, const HalfCounts &counts) {
    const std::lock_guard lock(results_);
    const std::size_t row = channels() * static_cast<std::size_t>(tile.x1 - tile.x0);
    std::size_t from = 0;
    for (int y = tile.y0; y < tile.y1; ++y, from += row) {
        const std::size_t pixel = static_cast<std::size_t>(y) * width() + static_cast<std::size_t>(tile.x0);
        state_.sums.add(channels() * pixel, sums, from, row);
    }
    state_.counts[index] = counts;
}

void Accumulator::cancel() { progress_->cancelled = true; }

double Accumulator::progress() const {
    return static_cast<double>(progress_->samples) / static_cast<double>(samples_to_take_);
}

std::size_t Accumulator::width() const { return static_cast<std::size_t>(scene_.scene->film().crop_width); }
std::size_t Accumulator::height() const { return static_cast<std::size_t>(scene_.scene->film().crop_height); }
std::size_t Accumulator::channels() const { return scene_.output.channel_count(); }
std::size_t Accumulator::tile_columns() const { return tiles_along(width()); }
std::size_t Accumulator::tile_rows() const { return tiles_along(height()); }

std::vector<float> Accumulator::image() const {
    const std::lock_guard lock(results_);
    return means(state_.sums, channels(), counts_of_pixels());
}

std::vector<std::uint32_t> Accumulator::pixel_counts() const {
    const std::lock_guard lock(results_);
    return counts_of_pixels();
}

std::vector<std::uint32_t> Accumulator::counts_of_pixels() const {
    const Film &film = scene_.scene->film();
    std::vector<std::uint32_t> result;
    result.reserve(width() * height());
    for (std::uint32_t y = 0; y < height(); ++y)
        for (std::uint32_t x = 0; x < width(); ++x) {
            const HalfCounts &tile = state_.counts[y / tile_size * tile_columns() + x / tile_size];
            result.push_back(tile[half_of(x + static_cast<std::uint32_t>(film.crop_offset_x),
                                          y + static_cast<std::uint32_t>(film.crop_offset_y))]);
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

std::vector<float> means(const Sums &sums, std::size_t channels, std::span<const std::uint32_t> counts) {
    std::vector<float> result(sums.size());
    for (std::size_t i = 0; i < result.size(); ++i) {
        const std::uint32_t count = counts[i / channels];
        result[i] = count > 0 ? static_cast<float>(sums.value(i) / count) : 0.0f;
    }
    return result;
}

} // namespace lajolla
