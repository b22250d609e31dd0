#pragma once
// The film's size, the list of pixel filters, and the samplers.

#include <tuple>
#include <variant>

#include "base/distribution.h"
#include "base/fields.h"
#include "base/match.h"
#include "base/sampler.h"

namespace lajolla {

struct Film {
    static constexpr const char *name = "film";
    static constexpr const char *doc = "Size of the picture, and the window of it that is rendered.";
    int width = 768, height = 576;
    int crop_offset_x = 0, crop_offset_y = 0, crop_width = 0, crop_height = 0;

    static constexpr auto fields() {
        return std::tuple(
            field("width", &Film::width, "of the whole picture").range(1, 65536).unit("pixels"),
            field("height", &Film::height, "of the whole picture").range(1, 65536).unit("pixels"),
            field("crop_offset_x", &Film::crop_offset_x, "left edge of the window")
                .range(0, 65536)
                .unit("pixels"),
            field("crop_offset_y", &Film::crop_offset_y, "top edge of the window")
                .range(0, 65536)
                .unit("pixels"),
            field("crop_width", &Film::crop_width, "0: to the right edge").range(0, 65536).unit("pixels"),
            field("crop_height", &Film::crop_height, "0: to the bottom edge").range(0, 65536).unit("pixels"));
    }
    void build();
    float aspect() const { return static_cast<float>(width) / static_cast<float>(height); }
};

// Filters of one variable, even functions that vanish beyond radius(); a pixel uses the product along both
// axes.

struct BoxFilter {
    static constexpr const char *name = "box";
    static constexpr const char *doc = "Box filter: equal weights within the pixel.";
    float filter_radius = 0.5f;
    static constexpr auto fields() {
        return std::tuple(
            field("radius", &BoxFilter::filter_radius, "half its width").range(1e-3, 64).unit("pixels"));
    }
    float radius() const { return filter_radius; }
    float operator()(float) const { return 1; }
};

struct TentFilter {
    static constexpr const char *name = "tent";
    static constexpr const char *doc = "Tent filter: linear falloff.";
    float filter_radius = 1;
    static constexpr auto fields() {
        return std::tuple(field("radius", &TentFilter::filter_radius, "distance at which it is zero")
                              .range(1e-3, 64)
                              .unit("pixels"));
    }
    float radius() const { return filter_radius; }
    float operator()(float x) const { return std::max(1 - std::abs(x) / filter_radius, 0.0f); }
};

struct GaussianFilter {
    static constexpr const char *name = "gaussian";
    static constexpr const char *doc =
        "Gaussian, truncated at four standard deviations and shifted to zero there.";
    float stddev = 0.5f;
    static constexpr auto fields() {
        return std::tuple(
            field("stddev", &GaussianFilter::stddev, "standard deviation").range(1e-3, 16).unit("pixels"));
    }
    float radius() const { return 4 * stddev; }
    float operator()(float x) const {
        const auto bell = [&](float t) { return exp(-t * t / (2 * stddev * stddev)); };
        return std::max(bell(x) - bell(radius()), 0.0f);
    }
};

struct MitchellFilter {
    static constexpr const char *name = "mitchell";
    static constexpr const char *doc = "Mitchell and Netravali's cubic (1988): preserves more detail than a "
                                       "Gaussian, with small negative lobes.";
    float b = 1.0f / 3, c = 1.0f / 3;
    static constexpr auto fields() {
        return std::tuple(field("B", &MitchellFilter::b, "blurring"),
                          field("C", &MitchellFilter::c, "ringing"));
    }
    float radius() const { return 2; }
    float operator()(float x) const {
        x = std::abs(x);
        if (x < 1)
            return ((12 - 9 * b - 6 * c) * x * x * x + (-18 + 12 * b + 6 * c) * x * x + (6 - 2 * b)) / 6;
        if (x < 2)
            return ((-b - 6 * c) * x * x * x + (6 * b + 30 * c) * x * x + (-12 * b - 48 * c) * x +
                    (8 * b + 24 * c)) /
                   6;
        return 0;
    }
};

struct CatmullRomFilter {
    static constexpr const char *name = "catmullrom";
    static constexpr const char *doc =
        "Catmull and Rom's interpolating cubic: Mitchell's with B = 0, C = 1/2.";
    static constexpr auto fields() { return std::tuple(); }
    float radius() const { return 2; }
    float operator()(float x) const { return MitchellFilter{0, 0.5f}(x); }
};

struct LanczosFilter {
    static constexpr const char *name = "lanczos";
    static constexpr const char *doc =
        "Lanczos filter: a sinc windowed by a sinc; most detail, with ringing.";
    int lobes = 3;
    static constexpr auto fields() {
        return std::tuple(
            field("lobes", &LanczosFilter::lobes, "zero crossings on either side").range(1, 16));
    }
    float radius() const { return static_cast<float>(lobes); }
    float operator()(float x) const {
        const auto sinc = [](float t) { return std::abs(t) < 1e-5f ? 1 : sin(pi * t) / (pi * t); };
        return std::abs(x) < radius() ? sinc(x) * sinc(x / radius()) : 0;
    }
};

using PixelFilter =
    std::variant<BoxFilter, TentFilter, GaussianFilter, MitchellFilter, CatmullRomFilter, LanczosFilter>;

// Samples offsets from the pixel's centre by a table of a filter's absolute value. The weight has the sign of
// the filter.
class FilterSampler {
public:
    template <class Float>
    struct Sample {
        Vec2<Float> offset; // pixels
        Float weight;       // 1 for filters without negative lobes
    };
    explicit FilterSampler(const PixelFilter &filter = BoxFilter{});
    template <class Float>
    Sample<Float> sample(const Vec2<Float> &u) const {
        const auto x = sample_axis(u.x), y = sample_axis(u.y);
        return {{x.offset, y.offset}, x.weight * y.weight};
    }

private:
    template <class Float>
    struct Axis {
        Float offset, weight;
    };
    template <class Float>
    Axis<Float> sample_axis(Float u) const {
        const auto cell = cells_.sample(u);
        const Float position = (to_float(cell.index) + cell.rest) / static_cast<float>(cells_.size());
        return {(2 * position - 1) * radius_, gather(weights_.data(), cell.index)};
    }

    Distribution cells_;
    std::vector<float> weights_;
    float radius_ = 0.5f;
};

// The sample count, and the sequence of random numbers.

struct SamplerBase {
    int sample_count = 4;
    std::uint32_t seed = 0;
};

struct SobolSampler : SamplerBase {
    static constexpr const char *name = "sobol";
    static constexpr const char *doc = "Owen-scrambled Sobol' points: less noise than independent ones.";
    static constexpr SequenceKind kind = SequenceKind::sobol;
    static constexpr auto fields() {
        return std::tuple(
            field("sample_count", &SobolSampler::sample_count, "samples per pixel").range(1, 1 << 30),
            field("seed", &SobolSampler::seed, "random seed").range(0));
    }
};

struct IndependentSampler : SamplerBase {
    static constexpr const char *name = "independent";
    static constexpr const char *doc = "Independent uniform numbers.";
    static constexpr SequenceKind kind = SequenceKind::independent;
    static constexpr auto fields() {
        return std::tuple(
            field("sample_count", &IndependentSampler::sample_count, "samples per pixel").range(1, 1 << 30),
            field("seed", &IndependentSampler::seed, "random seed").range(0));
    }
};

using SamplerModel = std::variant<SobolSampler, IndependentSampler>;

} // namespace lajolla
