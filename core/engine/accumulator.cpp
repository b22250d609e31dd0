#include "engine/accumulator.h"

#include <algorithm>

#include "engine/renderable.h"

namespace lajolla {

Accumulator::Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed)
    : scene_(scene), progress_(std::make_unique<Progress>()), seed_(seed.value_or(scene.seed)),
      sums_(channels() * pixels()) {}

Accumulator::~Accumulator() = default;

bool Accumulator::add(std::uint32_t first, std::uint32_t count, int threads, bool one_lane) {
    const std::lock_guard one_at_a_time(adding_);
    std::vector<double> next = sums_; // only add() writes sums_
    progress_->pixels = 0;
    const auto report = render(*scene_.scene, scene_.output,
                               {scene_.sequence, seed_, first, count, threads, one_lane}, next, *progress_);
    if (!report) {
        progress_->cancelled = false;
        return false;
    }
    const std::lock_guard lock(results_);
    sums_ = std::move(next);
    samples_ += count;
    rays_ += report->rays;
    nonfinite_ += report->nonfinite;
    for (const SampleId &id : report->nonfinite_samples)
        if (nonfinite_list_.size() < Report::kept_samples) nonfinite_list_.emplace_back(id.x, id.y, id.index);
    return true;
}

void Accumulator::cancel() { progress_->cancelled = true; }

double Accumulator::progress() const {
    return static_cast<double>(progress_->pixels) / static_cast<double>(pixels());
}

std::size_t Accumulator::width() const { return static_cast<std::size_t>(scene_.scene->film().crop_width); }
std::size_t Accumulator::height() const { return static_cast<std::size_t>(scene_.scene->film().crop_height); }
std::size_t Accumulator::channels() const { return scene_.output.channel_count(); }

std::vector<float> Accumulator::image() const {
    const std::lock_guard lock(results_);
    const double scale = samples_ > 0 ? 1 / static_cast<double>(samples_) : 0;
    std::vector<float> values(sums_.size());
    std::transform(sums_.begin(), sums_.end(), values.begin(),
                   [&](double sum) { return static_cast<float>(sum * scale); });
    return values;
}

} // namespace lajolla
