#include "scene/image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <type_traits>

#include "base/match.h"

namespace lajolla {

namespace {

using Table = std::array<float, 256>;

Table make_table(bool srgb) {
    Table table;
    for (std::size_t i = 0; i < table.size(); ++i) {
        const double x = static_cast<double>(i) / 255;
        table[i] = static_cast<float>(!srgb          ? x
                                      : x <= 0.04045 ? x / 12.92
                                                     : std::pow((x + 0.055) / 1.055, 2.4));
    }
    return table;
}

std::uint8_t encode_byte(float value, bool srgb) {
    const float x = std::clamp(value, 0.0f, 1.0f);
    const float encoded = !srgb ? x : x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
    return static_cast<std::uint8_t>(std::lround(255 * encoded));
}

// The texel index that an index outside [0, size) stands for, or -1 where the mode has no texels there.
std::int32_t wrap(std::int32_t i, std::int32_t size, WrapMode mode) {
    if (i >= 0 && i < size) return i;
    switch (mode) {
    case WrapMode::repeat: {
        const std::int32_t rest = i % size;
        return rest < 0 ? rest + size : rest;
    }
    case WrapMode::mirror: {
        const std::int32_t rest = ((i % (2 * size)) + 2 * size) % (2 * size);
        return rest < size ? rest : 2 * size - 1 - rest;
    }
    case WrapMode::clamp: return i < 0 ? 0 : size - 1;
    default: return -1;
    }
}

const Table srgb_bytes = make_table(true), linear_bytes = make_table(false);

// exp(-2 r^2), lowered to vanish at r = 1, over r^2 (Heckbert 1989, section 3.5.8).
constexpr std::size_t gaussian_steps = 256;
const auto gaussian_weights = [] {
    std::array<float, gaussian_steps> weights;
    for (std::size_t i = 0; i < gaussian_steps; ++i) {
        const double r_squared = (static_cast<double>(i) + 0.5) / gaussian_steps;
        weights[i] = static_cast<float>(std::exp(-2 * r_squared) - std::exp(-2.0));
    }
    return weights;
}();

const float *byte_decoding(bool srgb) { return (srgb ? srgb_bytes : linear_bytes).data(); }

float decode(std::uint8_t value, const float *table) { return table[value]; }
float decode(Image::Half value, const float *) { return static_cast<float>(value); }
float decode(float value, const float *) { return value; }

template <class Texel>
Spectrum fetch(const Texel *texel, std::uint32_t channels, const float *table) {
    if (channels == 1) return Spectrum(decode(texel[0], table));
    return {decode(texel[0], table), decode(texel[1], table), decode(texel[2], table)};
}

// Positions far outside the image lose their fraction anyway; this keeps them within the integers.
float bounded(float x) { return std::isfinite(x) ? std::clamp(x, -1e9f, 1e9f) : 0; }

// f(dx, dy, the four texels around a position), row by row; dx and dy count from the first one's centre.
template <class F>
[[gnu::always_inline]] inline auto between_texels(const Image &image, Vec2f position, WrapMode wrap_x,
                                                  WrapMode wrap_y, F &&f) {
    const float x = bounded(position.x - 0.5f), y = bounded(position.y - 0.5f);
    const float floor_x = std::floor(x), floor_y = std::floor(y), dx = x - floor_x, dy = y - floor_y;
    const auto width = static_cast<std::int32_t>(image.width),
               height = static_cast<std::int32_t>(image.height);
    const auto i = static_cast<std::int32_t>(floor_x), j = static_cast<std::int32_t>(floor_y);
    const std::int32_t i0 = wrap(i, width, wrap_x), i1 = wrap(i + 1, width, wrap_x);
    const std::int32_t j0 = wrap(j, height, wrap_y), j1 = wrap(j + 1, height, wrap_y);
    const float *table = byte_decoding(image.srgb);
    return match(image.texels, [&](const auto &texels) {
        const auto at = [&](std::int32_t column, std::int32_t row) {
            if (column < 0) return Spectrum(wrap_x == WrapMode::one ? 1.0f : 0.0f);
            if (row < 0) return Spectrum(wrap_y == WrapMode::one ? 1.0f : 0.0f);
            const auto index = static_cast<std::size_t>(row) * image.width + static_cast<std::size_t>(column);
            return fetch(texels.data() + index * image.channels, image.channels, table);
        };
        return f(dx, dy, at(i0, j0), at(i1, j0), at(i0, j1), at(i1, j1));
    });
}

} // namespace

std::array<float, 2> Image::bounds() const {
    constexpr float infinity = std::numeric_limits<float>::infinity();
    return match(texels, [&](const auto &values) -> std::array<float, 2> {
        if constexpr (std::is_same_v<std::decay_t<decltype(values)>, std::vector<std::uint8_t>>) {
            return {0, 1};
        } else {
            std::array<float, 2> result{infinity, -infinity};
            for (const auto value : values) {
                const auto x = static_cast<float>(value);
                if (std::isnan(x)) return {-infinity, infinity};
                result = {std::min(result[0], x), std::max(result[1], x)};
            }
            return result;
        }
    });
}

Spectrum nearest(const Image &image, Vec2f position, WrapMode mode) {
    const std::int32_t x = wrap(static_cast<std::int32_t>(std::floor(bounded(position.x))),
                                static_cast<std::int32_t>(image.width), mode);
    const std::int32_t y = wrap(static_cast<std::int32_t>(std::floor(bounded(position.y))),
                                static_cast<std::int32_t>(image.height), mode);
    if (x < 0 || y < 0) return Spectrum(mode == WrapMode::one ? 1.0f : 0.0f);
    return image.texel(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y));
}

Spectrum bilinear(const Image &image, Vec2f position, WrapMode wrap_x, WrapMode wrap_y) {
    return between_texels(image, position, wrap_x, wrap_y,
                          [](float dx, float dy, Spectrum a, Spectrum b, Spectrum c, Spectrum d) {
                              return lerp(dy, lerp(dx, a, b), lerp(dx, c, d));
                          });
}

std::array<Spectrum, 2> bilinear_gradient(const Image &image, Vec2f position, WrapMode wrap) {
    return between_texels(image, position, wrap, wrap,
                          [](float dx, float dy, Spectrum a, Spectrum b, Spectrum c, Spectrum d) {
                              return std::array{lerp(dy, b - a, d - c), lerp(dx, c - a, d - b)};
                          });
}

Spectrum gaussian(const Image &image, Vec2f position, const Conic &ellipse, WrapMode mode) {
    const float x = bounded(position.x - 0.5f), y = bounded(position.y - 0.5f);
    const float reach_x = std::sqrt(ellipse.xx), reach_y = std::sqrt(ellipse.yy);
    const auto first_x = static_cast<std::int32_t>(std::ceil(x - reach_x)),
               last_x = static_cast<std::int32_t>(std::floor(x + reach_x));
    const auto first_y = static_cast<std::int32_t>(std::ceil(y - reach_y)),
               last_y = static_cast<std::int32_t>(std::floor(y + reach_y));
    const auto width = static_cast<std::int32_t>(image.width),
               height = static_cast<std::int32_t>(image.height);
    const float scale = gaussian_steps / (ellipse.xx * ellipse.yy - sqr(ellipse.xy));
    const float *table = byte_decoding(image.srgb);
    const Spectrum outside(mode == WrapMode::one ? 1.0f : 0.0f);
    Spectrum sum(0);
    float total = 0;
    match(image.texels, [&](const auto &texels) {
        for (std::int32_t j = first_y; j <= last_y; ++j) {
            const float dy = static_cast<float>(j) - y;
            const std::int32_t row = wrap(j, height, mode);
            for (std::int32_t i = first_x; i <= last_x; ++i) {
                const float dx = static_cast<float>(i) - x; // p^T M^-1 p, in steps of the table
                const float r = scale * (dx * (ellipse.yy * dx - 2 * ellipse.xy * dy) + ellipse.xx * dy * dy);
                if (!(r < gaussian_steps)) continue;
                const float weight = gaussian_weights[static_cast<std::size_t>(std::max(r, 0.0f))];
                const std::int32_t column = wrap(i, width, mode);
                const auto index =
                    static_cast<std::size_t>(row) * image.width + static_cast<std::size_t>(column);
                sum += weight * (row < 0 || column < 0
                                     ? outside
                                     : fetch(texels.data() + index * image.channels, image.channels, table));
                total += weight;
            }
        }
    });
    return total > 0 ? sum / total : bilinear(image, position, mode, mode);
}

std::size_t Image::bytes() const {
    return match(texels, [](const auto &values) { return values.size() * sizeof(values[0]); });
}

Spectrum Image::texel(std::uint32_t x, std::uint32_t y) const {
    const std::size_t first = (static_cast<std::size_t>(y) * width + x) * channels;
    return match(texels, [&](const auto &values) {
        return fetch(values.data() + first, channels, byte_decoding(srgb));
    });
}

Image downsample(const Image &image) {
    Image half{std::max(image.width / 2, 1u), std::max(image.height / 2, 1u), image.channels, image.srgb, {}};
    const auto share = [](std::uint32_t i, std::uint32_t size, std::uint32_t smaller) {
        struct Span {
            std::uint32_t first, last;
            float low, high;
        };
        const float begin = static_cast<float>(i) * static_cast<float>(size) / static_cast<float>(smaller);
        const float end = static_cast<float>(i + 1) * static_cast<float>(size) / static_cast<float>(smaller);
        const auto first = static_cast<std::uint32_t>(begin);
        const auto last = std::min(static_cast<std::uint32_t>(std::ceil(end)), size);
        return Span{first, last, begin, end};
    };
    std::vector<float> linear(static_cast<std::size_t>(half.width) * half.height * half.channels);
    for (std::uint32_t y = 0; y < half.height; ++y) {
        const auto rows = share(y, image.height, half.height);
        for (std::uint32_t x = 0; x < half.width; ++x) {
            const auto columns = share(x, image.width, half.width);
            Spectrum sum{0};
            float total = 0;
            for (std::uint32_t j = rows.first; j < rows.last; ++j)
                for (std::uint32_t i = columns.first; i < columns.last; ++i) {
                    const auto overlap = [](std::uint32_t k, float low, float high) {
                        return std::min(static_cast<float>(k + 1), high) -
                               std::max(static_cast<float>(k), low);
                    };
                    const float weight =
                        overlap(j, rows.low, rows.high) * overlap(i, columns.low, columns.high);
                    sum += image.texel(i, j) * weight;
                    total += weight;
                }
            for (std::uint32_t c = 0; c < half.channels; ++c)
                linear[(static_cast<std::size_t>(y) * half.width + x) * half.channels + c] = sum[c] / total;
        }
    }
    match(image.texels, [&](const auto &values) {
        using Texel = std::decay_t<decltype(values[0])>;
        std::vector<Texel> encoded(linear.size());
        for (std::size_t i = 0; i < linear.size(); ++i) {
            if constexpr (std::is_same_v<Texel, std::uint8_t>)
                encoded[i] = encode_byte(linear[i], image.srgb);
            else encoded[i] = static_cast<Texel>(linear[i]);
        }
        half.texels = std::move(encoded);
    });
    return half;
}

} // namespace lajolla
