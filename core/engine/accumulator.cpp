#include "engine/accumulator.h"

#include <algorithm>
#include <stdexcept>

#include "engine/renderable.h"

namespace lajolla {

Accumulator::Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed,
                         std::uint32_t first_sample)
    : scene_(scene), seed_(seed.value_or(scene.seed)), first_sample_(first_sample),
      state_{Sums(width() * height() * channels()), Counts(scene.scene->film())} {}

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
    for (std::size_t i = 0; i < samples.size(); ++i) {
        std::uint32_t &target = targets.values()[i];
        job.ranges.values()[i].first = first_sample_ + target;
        target = std::max(target, samples[i]);
        job.ranges.values()[i].end = first_sample_ + target;
    }
    samples_to_take_ =
        std::max<std::uint64_t>(1, sample_count({0, 0, film.crop_width, film.crop_height}, job.ranges));
    progress_.samples = 0;
    const Report report = render(*scene_.scene, scene_.output, job, progress_,
                                 [&](const Tile &tile, const Sums &sums) { add_tile(tile, sums, targets); });
    const std::lock_guard lock(results_);
    state_.rays += report.rays;
    state_.nonfinite += report.nonfinite;
    for (const SampleId &id : report.nonfinite_samples)
        if (state_.nonfinite_list.size() < Report::kept_samples) state_.nonfinite_list.push_back(id);
    return !progress_.cancelled.exchange(false);
}

void Accumulator::add_tile(const Tile &tile, const Sums &sums, const Counts &counts) {
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
}

void Accumulator::cancel() { progress_.cancelled = true; }

double Accumulator::progress() const {
    return static_cast<double>(progress_.samples) / static_cast<double>(samples_to_take_);
}

std::size_t Accumulator::width() const { return static_cast<std::size_t>(scene_.scene->film().crop_width); }
std::size_t Accumulator::height() const { return static_cast<std::size_t>(scene_.scene->film().crop_height); }
std::size_t Accumulator::channels() const { return scene_.output.channel_count(); }

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
    if (state.sums.size() != state_.sums.size())
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
