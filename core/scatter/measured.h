#pragma once
// Materials measured by a goniophotometer, in the parameterisation of Dupuy and Jakob 2018, "An Adaptive
// Parameterization for Efficient Material Acquisition and Rendering": for each direction of the light, the
// unit square is warped to half vectors as a microfacet surface would reflect them, and what was measured is
// stored over the square before the warp.

#include <memory>
#include <stdexcept>

#include "base/warp.h"
#include "scatter/bsdf.h"
#include "scatter/squarewarp.h"

namespace lajolla {

// Tables as the files have them. The x axis of squares is sqrt(2 theta / pi), the y axis (phi + pi) / (2 pi).
struct MeasuredTables {
    template <class T>
    struct Square {
        SquareGrid grid;
        std::vector<T> nodes; // a slice after the other, each row by row
    };
    std::vector<float> phi, theta; // of the known direction; slices: theta runs first
    Square<float> ndf, sigma;      // density of normals; projected area, by direction
    Square<float> vndf, luminance; // of visible normals; of what was measured
    Square<Spectrum> colour;
    bool jacobian = true; // whether the colours are relative to the microfacet model
};

class Measurement {
public:
    explicit Measurement(MeasuredTables tables) // throws std::invalid_argument where they do not fit together
        : tables_((check(tables), std::move(tables))), isotropic_(tables_.phi.size() <= 2),
          fold_(isotropic_ ? 1 : std::lround(2 * pi / (tables_.phi.back() - tables_.phi.front()))),
          roughness_(roughness_of(tables_.ndf)), vndf_(std::move(tables_.vndf.nodes), tables_.vndf.grid),
          luminance_(std::move(tables_.luminance.nodes), tables_.luminance.grid) {}

    float roughness() const { return roughness_; }

    BsdfEval<float> eval(Vec3f wo, Vec3f wi) const {
        const Vec2f signs = folding(wo);
        wo = folded(wo, signs);
        wi = folded(wi, signs);
        const Vec3f m = normalize(wo + wi);
        const SliceMix blend = slices(wo);
        const Vec2f p = square(m, isotropic_ ? azimuth(wo) : 0);
        const auto [s, visible] = vndf_.invert(p, blend);
        const auto cell = tables_.colour.grid.cell(s);
        const Spectrum colour = blend.mix([&](std::uint32_t slice) {
            return tables_.colour.grid.value(tables_.colour.nodes, cell, slice);
        });
        // d(wi) = 4 (wo.m) sin(theta) d(theta) d(phi), with theta = pi x^2 / 2 and phi = 2 pi y - pi
        const float jacobian = 8 * sqr(pi) * dot(wo, m) * p.x * std::hypot(m.x, m.y);
        return {colour * (tables_.jacobian ? microfacets(p, wo) : 1),
                visible * luminance_.density(s, blend) / std::max(jacobian, 1e-15f)};
    }

    // A direction, perhaps below the surface.
    Vec3f sample(Vec3f wo, Vec2f u) const {
        const Vec2f signs = folding(wo);
        wo = folded(wo, signs);
        const SliceMix blend = slices(wo);
        const auto [x, y] = vndf_.sample(luminance_.sample(u, blend).position, blend).position;
        const float theta = sqr(x) * pi / 2, phi = (2 * y - 1) * pi + (isotropic_ ? azimuth(wo) : 0);
        const Vec3f m{std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)};
        return folded(m * (2 * dot(wo, m)) - wo, signs);
    }

private:
    MeasuredTables tables_; // without the nodes of those two that are warps
    bool isotropic_;
    long fold_; // 2: half of all azimuths were measured, by symmetry; 4: a quarter
    float roughness_;
    SquareWarp vndf_, luminance_;

    static float azimuth(Vec3f w) { return std::atan2(w.y, w.x); }
    static float elevation(Vec3f w) { return std::atan2(std::hypot(w.x, w.y), w.z); }
    // A direction in the unit square.
    static Vec2f square(Vec3f w, float from) {
        const float y = (azimuth(w) - from + pi) * (inv_pi / 2);
        return {std::sqrt(elevation(w) * 2 * inv_pi), y - std::floor(y)};
    }

    // The signs with which x and y are multiplied so that wo is where it was measured.
    Vec2f folding(Vec3f wo) const {
        const auto towards_negative = [](float v) { return std::signbit(v) ? 1.0f : -1.0f; };
        if (fold_ == 2) return Vec2f(1, 1) * towards_negative(wo.y);
        if (fold_ == 4) return {towards_negative(wo.x), towards_negative(wo.y)};
        return {1, 1};
    }
    static Vec3f folded(Vec3f w, Vec2f signs) { return {w.x * signs.x, w.y * signs.y, w.z}; }

    SliceMix slices(Vec3f wo) const {
        const Neighbours p = neighbours(tables_.phi, azimuth(wo)),
                         t = neighbours(tables_.theta, elevation(wo));
        const auto count = static_cast<std::uint32_t>(tables_.theta.size());
        SliceMix blend;
        blend.add(p.lower * count + t.lower, (1 - p.t) * (1 - t.t));
        blend.add(p.lower * count + t.upper, (1 - p.t) * t.t);
        blend.add(p.upper * count + t.lower, p.t * (1 - t.t));
        blend.add(p.upper * count + t.upper, p.t * t.t);
        return blend;
    }

    // The microfacet model without Fresnel's factor and shadowing, by which measurements were divided.
    float microfacets(Vec2f m, Vec3f wo) const {
        const auto value = [](const auto &table, Vec2f p) {
            return table.grid.value(table.nodes, table.grid.cell(p), 0);
        };
        const float sigma = value(tables_.sigma, square(wo, 0));
        return sigma > 1e-6f ? value(tables_.ndf, m) / (4 * sigma) : 0;
    }

    static void check(const MeasuredTables &t);
    static float roughness_of(const MeasuredTables::Square<float> &ndf);
};

inline void Measurement::check(const MeasuredTables &t) {
    const auto rising = [](const std::vector<float> &nodes) {
        return !nodes.empty() &&
               std::adjacent_find(nodes.begin(), nodes.end(), std::greater_equal{}) == nodes.end();
    };
    if (!rising(t.phi) || !rising(t.theta))
        throw std::invalid_argument("the directions measured do not rise");
    const auto require = [](const auto &table, std::size_t slices, const char *name) {
        if (table.grid.width < 2 || table.grid.height < 2 || table.nodes.size() != slices * table.grid.size())
            throw std::invalid_argument(std::string("\"") + name + "\" has an unexpected shape");
    };
    require(t.ndf, 1, "ndf");
    require(t.sigma, 1, "sigma");
    const std::size_t slices = t.phi.size() * t.theta.size();
    require(t.vndf, slices, "vndf");
    require(t.luminance, slices, "luminance");
    require(t.colour, slices, "colour");
}

// Half of the area of a GGX surface has a slope below alpha: the median slope tells how wide the lobe is.
inline float Measurement::roughness_of(const MeasuredTables::Square<float> &ndf) {
    const std::uint32_t width = ndf.grid.width, height = ndf.grid.height;
    std::vector<float> below(width); // area of the facets up to the elevation of a column
    const auto elevation_of = [&](std::uint32_t x) {
        return sqr(static_cast<float>(x) / ndf.grid.columns()) * pi / 2;
    };
    for (std::uint32_t x = 1; x < width; ++x) {
        const float theta = (elevation_of(x - 1) + elevation_of(x)) / 2;
        float sum = 0;
        for (std::uint32_t y = 0; y < height; ++y)
            sum += ndf.nodes[std::size_t{y} * width + x - 1] + ndf.nodes[std::size_t{y} * width + x];
        below[x] = below[x - 1] + sum * std::sin(2 * theta) * (elevation_of(x) - elevation_of(x - 1));
    }
    const auto half = std::lower_bound(below.begin(), below.end() - 1, below.back() / 2);
    const float theta = elevation_of(static_cast<std::uint32_t>(half - below.begin()));
    return std::clamp(std::sin(theta) / std::max(std::cos(theta), 1e-3f), 0.001f, 1.0f);
}

struct Measured {
    static constexpr const char *name = "measured";
    static constexpr const char *doc = "A material as a goniophotometer saw it (Dupuy and Jakob 2018).";
    std::shared_ptr<const Measurement> measurement;

    static constexpr auto fields() {
        return std::tuple(
            field("measurement", &Measured::measurement, "what was measured; black without it"));
    }
    BsdfTraits traits() const { return {.anisotropic = true}; }

    struct Lobe {
        const Measurement *measurement;

        float roughness() const { return measurement != nullptr ? measurement->roughness() : 1; }

        BsdfEval<float> eval(const Vec3f &wo, const Vec3f &wi) const {
            if (measurement == nullptr || wo.z <= 0 || wi.z <= 0) return {};
            return measurement->eval(wo, wi);
        }

        BsdfSample<float> sample(const Vec3f &wo, float, const Vec2f &u) const {
            if (measurement == nullptr || wo.z <= 0) return {};
            const Vec3f wi = measurement->sample(wo, u);
            const BsdfEval<float> e = eval(wo, wi);
            if (!(e.pdf > 1e-30f)) return {};
            return {true, wi, e.f_cos / e.pdf, e.pdf, 1, false, roughness()};
        }
    };

    Lobe prepare(const auto &) const { return {measurement.get()}; }
};

} // namespace lajolla
