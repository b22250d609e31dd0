#include "images/bitmap.h"

namespace lajolla {

namespace {

// M = radius0 radius0^T + radius1 radius1^T: its eigenvalues are the squared principal radii.
template <class Float>
Conic<Float> conic_of(Vec2<Float> radius0, Vec2<Float> radius1) {
    return {sqr(radius0.x) + sqr(radius1.x), radius0.x * radius0.y + radius1.x * radius1.y,
            sqr(radius0.y) + sqr(radius1.y)};
}

template <class Float>
struct Radii {
    Float major, minor; // squared
};

template <class Float>
Radii<Float> squared_radii(const Conic<Float> &m) {
    const Float middle = (m.xx + m.yy) * 0.5f, root = hypot((m.xx - m.yy) * 0.5f, m.xy);
    return {middle + root, max(middle - root, Float(0))};
}

// The ellipse along the same axes with other radii.
template <class Float>
Conic<Float> with_radii(const Conic<Float> &m, const Radii<Float> &radii) {
    const Float half_difference = (m.xx - m.yy) * 0.5f, root = hypot(half_difference, m.xy);
    const Float cosine = select(root > 0.0f, half_difference / root, Float(1)), // of 2 theta
        sine = select(root > 0.0f, m.xy / root, Float(0));
    const Float middle = (radii.major + radii.minor) * 0.5f, half = (radii.major - radii.minor) * 0.5f;
    return {middle + half * cosine, half * sine, middle - half * cosine};
}

} // namespace

MipMap::MipMap(std::shared_ptr<const Image> image, FilterType filter, WrapMode wrap)
    : image_(std::move(image)), filter_(filter), wrap_(wrap) {
    if (is_filtered()) image_->make_levels();
}

std::size_t MipMap::bytes() const { return image_->bytes(is_filtered() ? image_->levels().size() : 1); }

template <class Float>
Rgb<Float> MipMap::unfiltered(Vec2<Float> position) const {
    const Window<Float> whole = sharpest<Float>(*image_);
    return filter_ == FilterType::nearest ? nearest(*image_, in_texels(whole, position), wrap_)
                                          : bilinear_at(whole, position);
}

template <class Float>
std::array<Rgb<Float>, 2> MipMap::gradient(Vec2<Float> position) const {
    if (filter_ == FilterType::nearest) return {};
    const Window<Float> whole = sharpest<Float>(*image_);
    const auto [by_x, by_y] = bilinear_gradient(*image_, in_texels(whole, position), wrap_);
    return {by_x * whole.width, by_y * whole.height};
}

template <class Float>
Rgb<Float> MipMap::trilinear(Vec2<Float> position, Float level) const {
    const Float fine = clamp_number(level, 0.0f, coarsest());
    const auto index = to_int(fine);
    const Float between = fine - to_float(index);
    const Rgb<Float> finer = bilinear_at(window<Float>(*image_, index), position);
    const auto blended = between > 0.0f;
    if (!any(blended)) return finer;
    const Rgb<Float> coarser = bilinear_at(
        window<Float>(*image_, index + select(blended, IntOf<Float>(1), IntOf<Float>(0))), position);
    return select(blended, lerp(between, finer, coarser), finer);
}

template <class Float>
Rgb<Float> MipMap::elliptical(Vec2<Float> position, Vec2<Float> radius0, Vec2<Float> radius1,
                              float max_anisotropy, BoolOf<Float> round, Float level) const {
    const auto conic_at = [&](const Window<Float> &at) {
        return conic_of(in_texels(at, radius0), in_texels(at, radius1));
    };
    const Radii<Float> finest = squared_radii(conic_at(sharpest<Float>(*image_)));
    const Float minor = max(finest.minor, finest.major / sqr(max_anisotropy));
    const Float fine = log2(max(minor, Float(1))) * 0.5f; // the shorter radius covers one texel or two
    const auto magnified = !(finest.major > 1.0f), one_texel = !(fine < coarsest());
    const auto averaged = !round && !magnified && !one_texel;
    Rgb<Float> result;
    if (!all(averaged))
        result = trilinear(position, select(round, level, select(magnified, Float(0), Float(coarsest()))));
    if (!any(averaged)) return result;

    const auto average = [&](IntOf<Float> i, BoolOf<Float> active) {
        const Window<Float> texels = window<Float>(*image_, i);
        const Conic<Float> conic = conic_at(texels);
        Radii<Float> radii = squared_radii(conic); // at least a texel, else there might be none inside
        radii.major = max(radii.major, Float(1));
        radii.minor = max(max(radii.minor, radii.major / sqr(max_anisotropy)), Float(1));
        return gaussian(*image_, texels, in_texels(texels, position), with_radii(conic, radii), wrap_,
                        active);
    };
    const auto index = to_int(select(averaged, fine, Float(0)));
    const Float between = fine - to_float(index);
    const auto blended = averaged && between > 0.0f;
    const Rgb<Float> finer = average(index, averaged);
    const Rgb<Float> coarser = average(index + select(blended, IntOf<Float>(1), IntOf<Float>(0)), blended);
    return select(blended, lerp(between, finer, coarser), select(averaged, finer, result));
}

// These are all there is.
template Rgb<float> MipMap::unfiltered(Vec2<float>) const;
template Rgb<WideFloat> MipMap::unfiltered(Vec2<WideFloat>) const;
template std::array<Rgb<float>, 2> MipMap::gradient(Vec2<float>) const;
template std::array<Rgb<WideFloat>, 2> MipMap::gradient(Vec2<WideFloat>) const;
template Rgb<float> MipMap::trilinear(Vec2<float>, float) const;
template Rgb<WideFloat> MipMap::trilinear(Vec2<WideFloat>, WideFloat) const;
template Rgb<float> MipMap::elliptical(Vec2<float>, Vec2<float>, Vec2<float>, float, bool, float) const;
template Rgb<WideFloat> MipMap::elliptical(Vec2<WideFloat>, Vec2<WideFloat>, Vec2<WideFloat>, float, WideBool,
                                           WideFloat) const;

} // namespace lajolla
