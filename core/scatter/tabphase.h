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
        const float largest = *std::max_element(values.begin(), values.end());
        if (!(largest > 0)) throw std::invalid_argument("\"values\" must not all be zero");
        for (const float v : values) table_.push_back(v / largest);
        std::vector<float> areas(values.size() - 1);
        for (std::size_t i = 0; i < areas.size(); ++i) areas[i] = (table_[i] + table_[i + 1]) / 2;
        cells_ = Distribution(areas);
        const float norm = 1 / (2 * pi * cells_.sum() * step());
        for (float &v : table_) v *= norm;
    }

    struct Lobe {
        const TabulatedPhase *table;

        float eval(Vec3f wo, Vec3f wi) const { return table->value(deflection(wo, wi)); }
        PhaseSample sample(Vec3f wo, Vec2f u) const {
            const auto [h, pdf] = table->sample_deflection(u.x);
            return {direction_around(-wo, h, u.y), pdf};
        }
        float projected_area(Vec3f) const { return 1; }
    };

    Lobe prepare(const auto &) const { return {this}; }

private:
    float step() const { return 2 / static_cast<float>(values.size() - 1); }

    // The value at 1 - cos = h.
    float value(float h) const {
        const float last = static_cast<float>(table_.size() - 1),
                    x = std::clamp(last - h / step(), 0.0f, last);
        const std::size_t i = std::min(static_cast<std::size_t>(x), table_.size() - 2);
        return lerp(x - static_cast<float>(i), table_[i], table_[i + 1]);
    }

    struct Deflection {
        float height, value; // 1 - cos, and the value there
    };
    // Selects a cell by its area, then solves a quadratic equation in it.
    Deflection sample_deflection(float u) const {
        const auto [cell, probability, rest] = cells_.sample(u);
        const auto i = static_cast<std::size_t>(cell);
        const float a = table_[i], b = table_[i + 1];
        const float divisor = a + std::sqrt(lerp(rest, a * a, b * b));
        // Not at the ends, where the value may be zero.
        const float t = std::clamp(rest * (a + b) / std::max(divisor, std::numeric_limits<float>::min()),
                                   0x1p-20f, 1 - 0x1p-20f);
        return {(static_cast<float>(table_.size() - 1 - i) - t) * step(), lerp(t, a, b)};
    }

    std::vector<float> table_; // values, normalised
    Distribution cells_;
};

} // namespace lajolla
