#pragma once
// Multiple scattering between microfacets, which single-scattering models lose, as a wide lobe (Kulla and
// Conty 2017, "Revisiting Physically Based Shading at Imageworks"). If single scattering loses the fraction
// L(w) of the light along w, the lobe f(wo, wi) = L(wo) L(wi) / (pi mean(L)) is reciprocal and has the albedo
// L(wo).

#include <memory>
#include <vector>

#include "base/shared_table.h"
#include "scatter/microfacet.h"

namespace lajolla {

// The loss of a rough surface, tabulated over the cosine and one more coordinate (rows), because it depends
// on textures that are not read yet.
class LostLight {
public:
    // loss(surface, w, n) is the fraction of light along w that is lost; means over visible normals take
    // about n x n nodes. If the roughness `varies`, only the distribution of the surface is used.
    template <class Loss>
    LostLight(const Microfacet<float> &given, bool varies, const Loss &loss);

    // The fraction lost along w, which is above the surface.
    template <class Float>
    Float operator()(const Microfacet<Float> &surface, const Vec3<Float> &w) const {
        const Place<Float> column = place(sqrt(w.z), cosines);
        if (rows_ == Rows::single) return column.interpolate(values_.data());
        const Place<Float> row = place(row_coordinate(surface, w), row_count());
        const Place<Float> cell{row.index * cosines + column.index, column.rest};
        return lerp(row.rest, cell.interpolate(values_.data()), cell.interpolate(values_.data() + cosines));
    }

    // Its mean over a cosine-weighted hemisphere.
    template <class Float>
    Float mean(const Microfacet<Float> &surface) const {
        if (rows_ != Rows::alphas) return means_.back();
        return place(row_coordinate(surface, {0, 0, 1}), row_count()).interpolate(means_.data());
    }

private:
    // One roughness, isotropic: one row. Anisotropic: a row per azimuth, dense where the roughness along it
    // is small. Textured: a row per roughness; if it is anisotropic too, that of the smaller one, so that the
    // compensation is never too large.
    enum class Rows { single, azimuths, alphas };
    static Rows rows_of(const Microfacet<float> &surface, bool varies) {
        if (varies) return Rows::alphas;
        return surface.smaller_alpha() == surface.larger_alpha() ? Rows::single : Rows::azimuths;
    }
    int row_count() const { return rows_ == Rows::alphas ? 16 : rows_ == Rows::azimuths ? 9 : 1; }
    static constexpr int cosines = 48;

    template <class Float>
    struct Place { // between two nodes
        IntOf<Float> index;
        Float rest;

        Float interpolate(const float *values) const {
            return lerp(rest, gather(values, index), gather(values + 1, index));
        }
    };
    template <class Float>
    static Place<Float> place(Float coordinate, int count) { // coordinates from 0 to 1; NaN becomes 0
        const Float x = clamp_number(coordinate, 0.0f, 1.0f) * to_float(count - 1);
        const IntOf<Float> i = to_int(min(x, Float(to_float(count - 2))));
        return {i, x - to_float(i)};
    }

    template <class Float>
    Float row_coordinate(const Microfacet<Float> &surface, const Vec3<Float> &w) const {
        const Float small = surface.smaller_alpha(), large = surface.larger_alpha();
        return rows_ == Rows::alphas ? sqrt(small)
                                     : safe_sqrt((surface.alpha_along(w) - small) / (large - small));
    }
    float mean_of_row(int row) const;

    Rows rows_;
    std::vector<float> values_; // `cosines` for each row, linear in the root of the cosine
    std::vector<float> means_;  // of each row; for azimuths also the mean of all
};

template <class Loss>
LostLight::LostLight(const Microfacet<float> &given, bool varies, const Loss &loss)
    : rows_(rows_of(given, varies)) {
    const int rows = row_count();
    for (int row = 0; row < rows; ++row) {
        const float y = rows > 1 ? to_float(row) / to_float(rows - 1) : 0;
        const Microfacet<float> surface = varies ? Microfacet<float>(given.kind(), y * y, y * y) : given;
        const Vec2f azimuth = rows_ == Rows::azimuths ? surface.azimuth_of(y * y) : Vec2f{1, 0};
        for (int i = 0; i < cosines; ++i) {
            const float x = max(to_float(i) / (cosines - 1), 0.005f), z = x * x;
            const float sine = safe_sqrt(1 - z * z);
            const Vec3f w{sine * azimuth.x, sine * azimuth.y, z};
            values_.push_back(loss(surface, w, rows > 1 ? 32 : 96));
        }
        means_.push_back(mean_of_row(row));
    }
    if (rows_ == Rows::azimuths) {
        constexpr int n = 256;
        float sum = 0;
        for (int i = 0; i < n; ++i) {
            const auto [sine, cosine] = sine_cosine((to_float(i) + 0.5f) * (pi / 2 / n));
            sum += place(row_coordinate(given, {cosine, sine, 0}), rows).interpolate(means_.data());
        }
        means_.push_back(sum / n);
    }
}

// The integral of the interpolated loss times 2 mu dmu = 4 x^3 dx, mu = x^2. Simpson's rule is more exact
// than the table.
inline float LostLight::mean_of_row(int row) const {
    constexpr float h = 1.0f / (cosines - 1);
    const auto cube = [](float x) { return x * x * x; };
    float sum = 0;
    for (int i = 0; i + 1 < cosines; ++i) {
        const float *values = values_.data() + row * cosines + i;
        const float a = values[0], b = values[1];
        const float x = to_float(i) * h;
        sum += a * cube(x) + 2 * (a + b) * cube(x + h / 2) + b * cube(x + h);
    }
    return sum * h * 4 / 6;
}

// The loss if facets reflect all light.
inline std::shared_ptr<const LostLight> lost_by_reflection(const Microfacet<float> &surface, bool varies) {
    return shared_table(key_of(surface, std::uint32_t{varies}), [&] {
        return LostLight(surface, varies, [](const Microfacet<float> &facets, Vec3f w, int n) {
            return facets.mean_over_visible(w, n, [&](Vec3f m) {
                const Vec3f wi = reflect(w, m);
                return wi.z > 0 ? 1 - facets.masking(wi) : 1;
            });
        });
    });
}

// The fraction of that light that is not absorbed at its second and later bounces, over the mean loss:
// F^2 (1 - mean(L)) / (1 - F mean(L)) / mean(L), with F the mean reflectance of the facets (Hill 2018, "A
// Multi-Faceted Exploration", part 4).
template <class Float>
Rgb<Float> regained_by_reflection(Rgb<Float> f, std::type_identity_t<Float> mean) {
    mean = max(mean, Float(1e-6f));
    return f * f * ((1 - mean) / mean) / (Rgb<Float>(1) - f * mean);
}

} // namespace lajolla
