#pragma once
// Materials measured by a goniophotometer, in the parameterisation of Dupuy and Jakob 2018, "An Adaptive
// Parameterization for Efficient Material Acquisition and Rendering": for each direction of the light, the
// unit square is warped to the half vectors of a microfacet surface, and measurements are stored over the
// square before the warp.

#include <memory>
#include <stdexcept>

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/squarewarp.h"

namespace lajolla {

// The tables of files. The x axis of squares is sqrt(2 theta / pi), the y axis (phi + pi) / (2 pi).
struct MeasuredTables {
    struct Square {
        SquareGrid grid;
        std::vector<float> nodes; // a slice after the other, each row by row
    };
    std::vector<float> phi, theta; // of the known direction; slices: theta runs first
    Square ndf, sigma;             // density of normals; projected area, by direction
    Square vndf, luminance;        // density of visible normals; luminance of the measurement
    Square colour;                 // three numbers per node
    bool jacobian = true;          // whether the colours are relative to the microfacet model
};

class Measurement {
public:
    explicit Measurement(MeasuredTables tables) // throws std::invalid_argument if they do not match
        : tables_((check(tables), std::move(tables))), isotropic_(tables_.phi.size() <= 2),
          fold_(isotropic_ ? 1 : std::lround(2 * pi / (tables_.phi.back() - tables_.phi.front()))),
          roughness_(roughness_of(tables_.ndf)), vndf_(tables_.vndf.nodes, tables_.vndf.grid),
          luminance_(tables_.luminance.nodes, tables_.luminance.grid) {}

    const MeasuredTables &tables() const { return tables_; }
    float roughness() const { return roughness_; }

    template <class Float>
    BsdfEval<Float> eval(const Vec3<Float> &given_wo, const Vec3<Float> &given_wi) const {
        const Vec2<Float> signs = folding(given_wo);
        const Vec3<Float> wo = folded(given_wo, signs), wi = folded(given_wi, signs), m = normalize(wo + wi);
        const SliceMix<Float> blend = slices(wo);
        const Vec2<Float> p = square(m, isotropic_ ? azimuth(wo) : Float(0));
        const auto [s, visible] = vndf_.invert(p, blend);
        // d(wi) = 4 (wo.m) sin(theta) d(theta) d(phi), with theta = pi x^2 / 2 and phi = 2 pi y - pi
        const Float jacobian = 8 * sqr(pi) * dot(wo, m) * p.x * hypot(m.x, m.y);
        return {colour(s, blend) * (tables_.jacobian ? microfacets(p, wo) : Float(1)),
                visible * luminance_.density(s, blend) / max(jacobian, Float(1e-15f))};
    }

    // A direction, possibly below the surface.
    template <class Float>
    Vec3<Float> sample(const Vec3<Float> &given_wo, const Vec2<Float> &u) const {
        const Vec2<Float> signs = folding(given_wo);
        const Vec3<Float> wo = folded(given_wo, signs);
        const SliceMix<Float> blend = slices(wo);
        const auto [x, y] = vndf_.sample(luminance_.sample(u, blend).position, blend).position;
        const auto [sin_theta, cos_theta] = sine_cosine(sqr(x) * (pi / 2));
        const auto [sin_phi, cos_phi] = sine_cosine((2 * y - 1) * pi + (isotropic_ ? azimuth(wo) : Float(0)));
        return folded(reflect(wo, {sin_theta * cos_phi, sin_theta * sin_phi, cos_theta}), signs);
    }

private:
    MeasuredTables tables_;
    bool isotropic_;
    long fold_; // 2: half of all azimuths were measured, by symmetry; 4: a quarter
    float roughness_;
    SquareWarp vndf_, luminance_;

    template <class Float>
    static Float azimuth(const Vec3<Float> &w) {
        return atan2(w.y, w.x);
    }
    template <class Float>
    static Float elevation(const Vec3<Float> &w) {
        return atan2(hypot(w.x, w.y), w.z);
    }
    // A direction in the unit square.
    template <class Float>
    static Vec2<Float> square(const Vec3<Float> &w, Float from) {
        const Float y = (azimuth(w) - from + pi) * (inv_pi / 2);
        return {sqrt(elevation(w) * (2 * inv_pi)), y - floor(y)};
    }

    // The signs by which x and y are multiplied so that wo is in the measured range.
    template <class Float>
    Vec2<Float> folding(const Vec3<Float> &wo) const {
        const auto towards_negative = [](Float v) { return select(as_int(v) < 0, Float(1), Float(-1)); };
        if (fold_ == 2) return Vec2<Float>(1, 1) * towards_negative(wo.y);
        if (fold_ == 4) return {towards_negative(wo.x), towards_negative(wo.y)};
        return {1, 1};
    }
    template <class Float>
    static Vec3<Float> folded(const Vec3<Float> &w, const Vec2<Float> &signs) {
        return {w.x * signs.x, w.y * signs.y, w.z};
    }

    template <class Float>
    SliceMix<Float> slices(const Vec3<Float> &wo) const {
        const auto p = neighbours(tables_.phi, azimuth(wo)), t = neighbours(tables_.theta, elevation(wo));
        const auto count = static_cast<std::int32_t>(tables_.theta.size());
        SliceMix<Float> blend;
        const auto add = [&](IntOf<Float> row, Float share) {
            blend.add(row * count + t.lower, share * (1 - t.t));
            blend.add(row * count + t.upper, share * t.t);
        };
        add(p.lower, 1 - p.t);
        if (tables_.phi.size() > 1) add(p.upper, p.t);
        return blend;
    }

    template <class Float>
    Rgb<Float> colour(const Vec2<Float> &s, const SliceMix<Float> &blend) const {
        const float *const c = tables_.colour.nodes.data();
        const auto cell = tables_.colour.grid.cell(s);
        const auto node = [&](IntOf<Float> i) {
            return Rgb<Float>(gather(c, 3 * i), gather(c + 1, 3 * i), gather(c + 2, 3 * i));
        };
        return blend.mix([&](IntOf<Float> slice) { return tables_.colour.grid.value(cell, slice, node); });
    }

    // The microfacet model without Fresnel term and shadowing, by which measurements are divided.
    template <class Float>
    Float microfacets(const Vec2<Float> &m, const Vec3<Float> &wo) const {
        const auto value = [](const MeasuredTables::Square &table, const Vec2<Float> &p) {
            const auto node = [&](IntOf<Float> i) { return gather(table.nodes.data(), i); };
            return table.grid.value(table.grid.cell(p), IntOf<Float>(0), node);
        };
        const Float sigma = value(tables_.sigma, square(wo, Float(0)));
        return select(sigma > 1e-6f, value(tables_.ndf, m) / (4 * sigma), Float(0));
    }

    static void check(const MeasuredTables &t);
    static float roughness_of(const MeasuredTables::Square &ndf);
};

inline void Measurement::check(const MeasuredTables &t) {
    const auto rising = [](const std::vector<float> &nodes) {
        return !nodes.empty() &&
               std::adjacent_find(nodes.begin(), nodes.end(), std::greater_equal{}) == nodes.end();
    };
    if (!rising(t.phi) || !rising(t.theta))
        throw std::invalid_argument("the directions measured do not rise");
    const auto require = [](const MeasuredTables::Square &table, std::size_t slices, const char *name) {
        const auto width = static_cast<std::size_t>(table.grid.width),
                   height = static_cast<std::size_t>(table.grid.height);
        if (width < 2 || height < 2 || table.nodes.size() != slices * width * height)
            throw std::invalid_argument(std::string("\"") + name + "\" has an unexpected shape");
        if (table.nodes.size() >= 1u << 31) // lanes have 32-bit integers
            throw std::invalid_argument(std::string("\"") + name + "\" has too many nodes");
    };
    require(t.ndf, 1, "ndf");
    require(t.sigma, 1, "sigma");
    const std::size_t slices = t.phi.size() * t.theta.size();
    require(t.vndf, slices, "vndf");
    require(t.luminance, slices, "luminance");
    require(t.colour, 3 * slices, "colour");
}

// Half of the area of a GGX surface has a slope below alpha: the median slope measures the width of the lobe.
inline float Measurement::roughness_of(const MeasuredTables::Square &ndf) {
    const auto width = static_cast<std::size_t>(ndf.grid.width),
               height = static_cast<std::size_t>(ndf.grid.height);
    std::vector<float> below(width); // area of the facets up to the elevation of a column
    const auto elevation_of = [&](std::size_t x) {
        return sqr(static_cast<float>(x) / ndf.grid.columns()) * pi / 2;
    };
    for (std::size_t x = 1; x < width; ++x) {
        const float theta = (elevation_of(x - 1) + elevation_of(x)) / 2;
        float sum = 0;
        for (std::size_t y = 0; y < height; ++y)
            sum += ndf.nodes[y * width + x - 1] + ndf.nodes[y * width + x];
        below[x] = below[x - 1] + sum * sin(2 * theta) * (elevation_of(x) - elevation_of(x - 1));
    }
    const auto half = std::lower_bound(below.begin(), below.end() - 1, below.back() / 2);
    const float theta = elevation_of(static_cast<std::size_t>(half - below.begin()));
    return std::clamp(sin(theta) / max(cos(theta), 1e-3f), 0.001f, 1.0f);
}

struct Measured {
    static constexpr const char *name = "measured";
    static constexpr const char *doc = "A measured material (Dupuy and Jakob 2018).";
    std::shared_ptr<const Measurement> measurement;

    static constexpr auto fields() {
        return std::tuple(
            field("measurement", &Measured::measurement, "what was measured; black without it"));
    }
    BsdfTraits traits() const { return {.anisotropic = true}; }

    template <class Float>
    struct Lobe {
        const Measurement *measurement;

        float roughness() const { return measurement ? measurement->roughness() : 1; }

        BsdfEval<Float> eval(const Vec3<Float> &wo, const Vec3<Float> &wi) const {
            if (!measurement) return {};
            return select(wo.z > 0.0f && wi.z > 0.0f, measurement->eval(wo, wi), {});
        }

        BsdfSample<Float> sample(const Vec3<Float> &wo, Float, const Vec2<Float> &u) const {
            if (!measurement) return {};
            const Vec3<Float> wi = measurement->sample(wo, u);
            const BsdfEval<Float> e = eval(wo, wi);
            return {.valid = e.pdf > 1e-30f,
                    .wi = wi,
                    .weight = e.f_cos / e.pdf,
                    .pdf = e.pdf,
                    .width = roughness()};
        }
    };

    template <class Float>
    Lobe<Float> prepare(const auto &) const {
        return {measurement.get()};
    }
};

} // namespace lajolla
