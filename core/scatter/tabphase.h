#pragma once

#include <span>
#include <stdexcept>
#include <vector>

#include "base/distribution.h"
#include "scatter/phase.h"

namespace lajolla {

struct TabulatedPhase {
    static constexpr const char *name = "tabphase";
    static constexpr const char *doc =
        "A measured phase function: values over the cosine, straight lines in between.";
    std::vector<float> values{1, 1};

    static constexpr auto fields() {
        return std::tuple(
            field("values", &TabulatedPhase::values,
                  "at even steps of the cosine from -1 (backwards) to 1 (forwards), of any scale")
                .range(0));
    }

    void build() {
        if (values.size() < 2 || values.size() > (1u << 20))
            throw std::invalid_argument("\"values\" must be two numbers or more, up to a million");
        std::vector<float> areas(values.size() - 1);
        const float largest = *std::max_element(values.begin(), values.end());
        if (!(largest > 0)) throw std::invalid_argument("\"values\" must not all be zero");
        for (std::size_t i = 0; i < areas.size(); ++i)
            areas[i] = values[i] / largest / 2 + values[i + 1] / largest / 2;
        cells_ = Distribution(areas);
        scale_ = 1 / (2 * pi * largest * cells_.sum() * step());
    }

    struct Lobe {
        const TabulatedPhase *table;

        float eval(Vec3f wo, Vec3f wi) const { return table->value(deflection(wo, wi)); }
        PhaseSample sample(Vec3f wo, Vec2f u) const {
            const Vec3f wi = direction_around(-wo, table->sample_deflection(u.x), u.y);
            return {wi, eval(wo, wi)};
        }
        float projected_area(Vec3f) const { return 1; }
    };

    Lobe prepare(const auto &) const { return {this}; }

private:
    float step() const { return 2 / static_cast<float>(values.size() - 1); }

    // The normalised value at 1 - cos = h.
    float value(float h) const {
        const float last = static_cast<float>(values.size() - 1),
                    x = std::clamp(last - h / step(), 0.0f, last);
        const std::size_t i = std::min(static_cast<std::size_t>(x), values.size() - 2);
        return scale_ * lerp(x - static_cast<float>(i), values[i], values[i + 1]);
    }

    // 1 - cos, by the areas of the cells and the quadratic equation within one.
    float sample_deflection(float u) const {
        const auto [i, probability, rest] = cells_.sample(u);
        const float a = values[i], b = values[i + 1];
        const float divisor = a + std::sqrt(lerp(rest, a * a, b * b));
        const float t = divisor > 0 ? std::min(rest * (a + b) / divisor, 1.0f) : rest;
        return (static_cast<float>(values.size() - 1 - i) - t) * step();
    }

    Distribution cells_;
    float scale_ = 0;
};

} // namespace lajolla
