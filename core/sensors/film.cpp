#include "sensors/film.h"

#include <stdexcept>
#include <string>

namespace lajolla {

void Film::build() {
    if (crop_width == 0) crop_width = width - crop_offset_x;
    if (crop_height == 0) crop_height = height - crop_offset_y;
    if (crop_width <= 0 || crop_height <= 0 || crop_offset_x + crop_width > width ||
        crop_offset_y + crop_height > height)
        throw std::invalid_argument("the crop window reaches beyond the picture of " + std::to_string(width) +
                                    " x " + std::to_string(height) + " pixels");
}

FilterSampler::FilterSampler(const PixelFilter &filter) {
    constexpr int cells = 1024;
    std::vector<float> magnitudes(cells);
    weights_.resize(cells);
    match(filter, [&](const auto &f) {
        radius_ = f.radius();
        double signed_sum = 0, sum = 0;
        for (std::size_t i = 0; i < cells; ++i) {
            const float x = ((static_cast<float>(i) + 0.5f) / cells * 2 - 1) * radius_;
            const float value = f(x);
            magnitudes[i] = std::abs(value);
            weights_[i] = value < 0 ? -1.0f : 1.0f;
            signed_sum += value, sum += magnitudes[i];
        }
        if (!(signed_sum > 0)) throw std::invalid_argument("the pixel filter has no positive integral");
        for (float &weight : weights_) weight *= static_cast<float>(sum / signed_sum);
    });
    cells_ = Distribution(magnitudes);
}

} // namespace lajolla
