#pragma once
// The light that bounces more than once between microfacets, which Smith's masking drops, given back as a
// wide lobe (Kulla and Conty 2017, "Revisiting Physically Based Shading at Imageworks"): with the fraction
// L(w) of the light along w that single scattering loses, L(wo) L(wi) / (pi mean(L)) scatters exactly that
// much and is reciprocal.

#include <algorithm>
#include <memory>
#include <vector>

#include "scatter/microfacet.h"

namespace lajolla {

// Directions over a rough surface whose textures are not read yet: the loss is tabulated over the cosine and,
// in rows, over what else it depends on.
class LostLight {
public:
    // loss(surface, w, n) is what light along w loses; means over visible normals take about n x n nodes. Of
    // a roughness that `varies` the surface given tells no more than the kind.
    template <class Loss>
    LostLight(const Microfacet &given, bool varies, const Loss &loss);

    // The fraction that is lost along w, which is above the surface.
    float operator()(const Microfacet &surface, Vec3f w) const;

    // Its mean over a cosine-weighted hemisphere.
    float mean(const Microfacet &surface) const {
        if (rows_ == Rows::azimuths) return means_.back();
        const Place row = place(row_coordinate(surface, {0, 0, 1}), means_.size());
        return lerp(row.rest, means_[row.index], means_[row.index + 1]);
    }

private:
    // One roughness, isotropic: two equal rows. Anisotropic: a row per azimuth, dense where the roughness
    // along it is small. Textured: a row per roughness; where that is anisotropic as well the smaller one
    // counts, so that too much is never given back.
    enum class Rows { equal, azimuths, alphas };
    static Rows rows_of(const Microfacet &surface, bool varies) {
        if (varies) return Rows::alphas;
        return surface.smaller_alpha() == surface.larger_alpha() ? Rows::equal : Rows::azimuths;
    }
    static constexpr std::size_t cosines = 48;

    struct Place { // between two nodes
        std::size_t index;
        float rest;
    };
    static Place place(float coordinate, std::size_t count) { // coordinates from 0 to 1
        const float x = std::clamp(coordinate, 0.0f, 1.0f) * static_cast<float>(count - 1);
        const std::size_t i = std::min(static_cast<std::size_t>(x), count - 2);
        return {i, x - static_cast<float>(i)};
    }

    float row_coordinate(const Microfacet &surface, Vec3f w) const {
        const float small = surface.smaller_alpha(), large = surface.larger_alpha();
        switch (rows_) {
        case Rows::azimuths: return safe_sqrt((surface.alpha_along(w) - small) / (large - small));
        case Rows::alphas: return std::sqrt(small);
        case Rows::equal: break;
        }
        return 0;
    }
    float mean_of_row(std::size_t row) const;

    Rows rows_;
    std::vector<float> values_; // `cosines` for each row, linear in the root of the cosine
    std::vector<float> means_;  // of each row; for azimuths one more, that of all
};

template <class Loss>
LostLight::LostLight(const Microfacet &given, bool varies, const Loss &loss) : rows_(rows_of(given, varies)) {
    const std::size_t rows = rows_ == Rows::alphas ? 16 : rows_ == Rows::azimuths ? 9 : 1;
    for (std::size_t row = 0; row < rows; ++row) {
        const float y = rows > 1 ? static_cast<float>(row) / static_cast<float>(rows - 1) : 0;
        const Microfacet surface = varies ? Microfacet(given.kind(), y * y, y * y) : given;
        const Vec2f azimuth = rows_ == Rows::azimuths ? surface.azimuth_of(y * y) : Vec2f{1, 0};
        for (std::size_t i = 0; i < cosines; ++i) {
            const float x = std::max(static_cast<float>(i) / (cosines - 1), 0.005f), z = x * x;
            const float sine = safe_sqrt(1 - z * z);
            const Vec3f w{sine * azimuth.x, sine * azimuth.y, z};
            values_.push_back(loss(surface, w, rows > 1 ? 32 : 96));
        }
        means_.push_back(mean_of_row(row));
    }
    if (rows_ == Rows::equal) {
        values_.resize(2 * cosines);
        std::copy_n(values_.begin(), cosines, values_.begin() + cosines);
        means_.push_back(means_[0]);
    }
    if (rows_ == Rows::azimuths) {
        constexpr int n = 256;
        float sum = 0;
        for (int i = 0; i < n; ++i) {
            const float phi = (static_cast<float>(i) + 0.5f) * (pi / 2 / n);
            const Place row = place(row_coordinate(given, {std::cos(phi), std::sin(phi), 0}), rows);
            sum += lerp(row.rest, means_[row.index], means_[row.index + 1]);
        }
        means_.push_back(sum / n);
    }
}

inline float LostLight::operator()(const Microfacet &surface, Vec3f w) const {
    const Place row = place(row_coordinate(surface, w), values_.size() / cosines),
                column = place(std::sqrt(w.z), cosines);
    const float *first = &values_[row.index * cosines + column.index], *second = first + cosines;
    return lerp(row.rest, lerp(column.rest, first[0], first[1]), lerp(column.rest, second[0], second[1]));
}

// The integral of the interpolated loss times 2 mu dmu = 4 x^3 dx, mu = x^2: Simpson's rule is exact to
// terms that the table is not.
inline float LostLight::mean_of_row(std::size_t row) const {
    constexpr float h = 1.0f / (cosines - 1);
    const auto cube = [](float x) { return x * x * x; };
    float sum = 0;
    for (std::size_t i = 0; i + 1 < cosines; ++i) {
        const float a = values_[row * cosines + i], b = values_[row * cosines + i + 1];
        const float x = static_cast<float>(i) * h;
        sum += a * cube(x) + 2 * (a + b) * cube(x + h / 2) + b * cube(x + h);
    }
    return sum * h * 4 / 6;
}

// Where facets reflect everything.
inline std::shared_ptr<const LostLight> lost_by_reflection(const Microfacet &surface, bool varies) {
    return std::make_shared<LostLight>(surface, varies, [](const Microfacet &facets, Vec3f w, int n) {
        return facets.mean_over_visible(w, n, [&](Vec3f m) {
            const Vec3f wi = reflect(w, m);
            return wi.z > 0 ? 1 - facets.masking(wi) : 1;
        });
    });
}

// The fraction of that light that is not absorbed at its second and later bounces, over the mean loss: the
// geometric series of F mean(L) after F^2 (1 - mean(L)), with F the mean reflectance of the facets (Hill
// 2018, "A Multi-Faceted Exploration", part 4).
inline Spectrum regained_by_reflection(Spectrum f, float mean) {
    mean = std::max(mean, 1e-6f);
    return f * f * ((1 - mean) / mean) / (Spectrum(1) - f * mean);
}

} // namespace lajolla
