#include "images/image.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <type_traits>

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

const Table srgb_bytes = make_table(true), linear_bytes = make_table(false);

} // namespace

float linear_byte(std::uint8_t value, bool srgb) { return (srgb ? srgb_bytes : linear_bytes)[value]; }

namespace {

std::uint8_t encode_byte(float value, bool srgb) {
    const float x = clamp(value, 0.0f, 1.0f);
    const float encoded = !srgb ? x : x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
    return static_cast<std::uint8_t>(std::lround(255 * encoded));
}

// --- texels in memory ------------------------------------------------------------------------------------

template <class T>
constexpr TexelType type_of = std::is_same_v<T, std::uint8_t>  ? TexelType::byte
                              : std::is_same_v<T, Image::Half> ? TexelType::half
                                                               : TexelType::real;

std::uint32_t bits_of(std::uint8_t value) { return value; }
std::uint32_t bits_of(Image::Half value) { return std::bit_cast<std::uint16_t>(value); }
std::uint32_t bits_of(float value) { return std::bit_cast<std::uint32_t>(value); }

std::size_t values_per_word(TexelType type) {
    return type == TexelType::byte ? 4 : type == TexelType::half ? 2 : 1;
}
std::size_t values_per_texel(TexelType type, std::uint32_t channels) {
    return channels == 3 && type != TexelType::real ? 4 : channels;
}

std::int32_t shifted(std::int32_t word, std::int32_t count) { return word >> count; }
WideInt shifted(WideInt word, WideInt count) { return WideInt(word.v >> count.v); }

// The value of the lowest 16 bits as a half: sign, five bits of exponent and ten of mantissa.
template <class Int>
auto half_to_float(Int word) {
#if defined(__F16C__)
    if constexpr (std::is_same_v<Int, std::int32_t>) // the processor can
        return static_cast<float>(std::bit_cast<Image::Half>(static_cast<std::uint16_t>(word)));
#endif
    const auto sign = (word & 0x8000) << 16;
    const auto rest = (word & 0x7fff) << 13; // where they are in a float, whose exponent is larger by 112
    const auto finite = as_int(as_float(rest) * 0x1p112f);
    return as_float(sign | select((word & 0x7c00) == 0x7c00, rest | 0x7f800000, finite));
}

// Calls f with a function from a texel's index to its value: a Float of grey images, else an Rgb<Float>.
template <class Float, class F>
[[gnu::always_inline]] inline auto with_texels(const Image &image, F &&f) {
    using Int = IntOf<Float>;
    const std::int32_t *words = image.words();
    const auto word = [=](Int i) { return gather(words, i); };
    switch (image.type) {
    case TexelType::byte: {
        const float *table = (image.srgb ? srgb_bytes : linear_bytes).data();
        const auto decode = [=](Int byte) { return gather(table, byte & 255); };
        if (image.channels == 1) return f([=](Int i) { return decode(shifted(word(i >> 2), (i & 3) << 3)); });
        return f([=](Int i) {
            const Int rgb = word(i);
            return Rgb<Float>{decode(rgb), decode(rgb >> 8), decode(rgb >> 16)};
        });
    }
    case TexelType::half:
        if (image.channels == 1)
            return f([=](Int i) { return half_to_float(shifted(word(i >> 1), (i & 1) << 4)); });
        return f([=](Int i) {
            const Int rg = word(i << 1), b = word((i << 1) + 1);
            return Rgb<Float>{half_to_float(rg), half_to_float(rg >> 16), half_to_float(b)};
        });
    default:
        if (image.channels == 1) return f([=](Int i) { return as_float(word(i)); });
        return f([=](Int i) {
            const Int r = i * 3;
            return Rgb<Float>{as_float(word(r)), as_float(word(r + 1)), as_float(word(r + 2))};
        });
    }
}

// --- positions -------------------------------------------------------------------------------------------

// Positions far outside the image lose their fraction anyway; this keeps them within the integers.
template <class Float>
Float bounded(Float x) {
    return select(isfinite(x), clamp(x, -1e9f, 1e9f), Float(0));
}

template <class Float>
BoolOf<Float> is_inside(Float i, Float size) {
    return i >= 0.0f && i < size;
}

// i modulo size, of whole numbers; in [0, size) as long as i is below 2^24.
template <class Float>
Float modulo(Float i, Float size) {
    const Float rest =
        i - floor(i * (1 / size)) * size; // or size less, or size more, for the quotient was rounded
    return rest + select(rest < 0.0f, size, select(rest < size, Float(0), -size));
}

// The texel used for an index outside of [0, size); always inside.
template <class Float>
Float wrap(Float i, Float size, WrapMode mode) {
    if (all(is_inside(i, size))) return i;
    if (mode == WrapMode::repeat) {
        i = modulo(i, size);
    } else if (mode == WrapMode::mirror) {
        const Float rest = modulo(i, 2 * size);
        i = select(rest < size, rest, 2 * size - 1 - rest);
    }
    return clamp(i, 0.0f, size - 1);
}

bool has_border(WrapMode mode) { return mode == WrapMode::zero || mode == WrapMode::one; }

// The value beyond the border, instead of the texel that `wrap` returned.
template <class Value, class Float>
[[gnu::always_inline]] inline Value with_border(const Value &texel, Float i, Float size, WrapMode mode) {
    if (!has_border(mode)) return texel;
    return select(is_inside(i, size), texel, Value(Float(mode == WrapMode::one ? 1.0f : 0.0f)));
}

// interpolate(dx, dy, the four texels around a position), row by row; dx and dy count from the first one's
// centre.
template <class Float, class Interpolate>
[[gnu::always_inline]] inline auto between_texels(const Image &image, const Window<Float> &window,
                                                  Vec2<Float> position, WrapMode wrap_x, WrapMode wrap_y,
                                                  Interpolate &&interpolate) {
    const Float x = bounded(position.x - 0.5f), y = bounded(position.y - 0.5f);
    const Float i = floor(x), j = floor(y), dx = x - i, dy = y - j;
    const auto column = to_int(wrap(i, window.width, wrap_x)),
               next = to_int(wrap(i + 1, window.width, wrap_x));
    const auto first_of_row = [&](Float row) {
        return window.first + to_int(wrap(row, window.height, wrap_y)) * to_int(window.width);
    };
    const auto row = first_of_row(j), next_row = first_of_row(j + 1);
    return with_texels<Float>(
        image, [&](const auto &texel) __attribute__((always_inline)) {
            const auto at = [&](const auto &index, Float column_, Float row_) __attribute__((always_inline)) {
                return with_border(with_border(texel(index), row_, window.height, wrap_y), column_,
                                   window.width, wrap_x);
            };
            return interpolate(dx, dy, at(row + column, i, j), at(row + next, i + 1, j),
                               at(next_row + column, i, j + 1), at(next_row + next, i + 1, j + 1));
        });
}

} // namespace

// --- images ----------------------------------------------------------------------------------------------

Image::Image(std::uint32_t width_, std::uint32_t height_, std::uint32_t channels_, bool srgb_,
             TexelType type_)
    : width(width_), height(height_), channels(channels_), srgb(srgb_), type(type_) {
    const auto half = [](std::uint32_t size) { return size > 1 ? size / 2 : 1; };
    std::size_t texels = 0;
    for (Level level{width, height, 0};; level.width = half(level.width), level.height = half(level.height)) {
        level.first = static_cast<std::int32_t>(texels);
        levels_.push_back(level);
        first_texels_.push_back(level.first);
        texels += static_cast<std::size_t>(level.width) * level.height;
        texels = (texels + 3) / 4 * 4; // no word belongs to two levels
        if (std::max(texels, words_before(texels)) > std::numeric_limits<std::int32_t>::max())
            throw std::invalid_argument("an image has more texels than 32 bits can count");
        if (level.width <= 1 && level.height <= 1) break;
    }
    words_.reserve(words_before(texels));
    words_.resize(bytes() / 4);
}

std::size_t Image::words_before(std::size_t texel) const {
    return texel * values_per_texel(type, channels) / values_per_word(type);
}

std::size_t Image::bytes(std::size_t level_count) const {
    std::size_t texels = 0;
    for (std::size_t i = 0; i < level_count; ++i)
        texels += (static_cast<std::size_t>(levels_[i].width) * levels_[i].height + 3) / 4 * 4;
    return 4 * words_before(texels);
}

template <class T>
void Image::put(std::size_t texel, std::size_t channel, T value) const {
    constexpr std::size_t per_word = 4 / sizeof(T);
    const std::size_t i = texel * values_per_texel(type, channels) + channel;
    words_[i / per_word] |= static_cast<std::int32_t>(bits_of(value) << (8 * sizeof(T) * (i % per_word)));
}

template <class T>
Image::Image(std::uint32_t width_, std::uint32_t height_, std::uint32_t channels_, bool srgb_,
             const T *values)
    : Image(width_, height_, channels_, srgb_, type_of<T>) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(width) * height; ++i)
        for (std::size_t c = 0; c < channels; ++c) put(i, c, *values++);
}
template Image::Image(std::uint32_t, std::uint32_t, std::uint32_t, bool, const std::uint8_t *);
template Image::Image(std::uint32_t, std::uint32_t, std::uint32_t, bool, const Half *);
template Image::Image(std::uint32_t, std::uint32_t, std::uint32_t, bool, const float *);

Image::Image(std::uint32_t width_, std::uint32_t height_, std::uint32_t channels_, bool srgb_,
             TexelType type_, std::span<const std::int32_t> words)
    : Image(width_, height_, channels_, srgb_, type_) {
    if (words.size() != words_.size()) throw std::invalid_argument("the words are of another image");
    std::ranges::copy(words, words_.begin());
}

Spectrum Image::texel(std::uint32_t x, std::uint32_t y) const {
    const auto i = static_cast<std::int32_t>(static_cast<std::size_t>(y) * width + x);
    return with_texels<float>(*this, [=](const auto &at) { return Spectrum(at(i)); });
}

std::array<float, 2> Image::bounds() const {
    if (type == TexelType::byte) return {0, 1};
    std::array<float, 2> result{infinity, -infinity};
    for (std::uint32_t y = 0; y < height; ++y)
        for (std::uint32_t x = 0; x < width; ++x) {
            const Spectrum value = texel(x, y);
            for (std::size_t c = 0; c < channels; ++c) {
                if (std::isnan(value[c])) return {-infinity, infinity};
                result = {min(result[0], value[c]), max(result[1], value[c])};
            }
        }
    return result;
}

void Image::make_levels() const {
    std::call_once(levels_made_, [&] {
        words_.resize(bytes(levels_.size()) / 4); // within what is reserved
        for (std::size_t i = 1; i < levels_.size(); ++i) downsample(levels_[i - 1], levels_[i]);
    });
}

// Halves the resolution by averaging linear values, each texel by the share of its area.
void Image::downsample(const Level &from, const Level &to) const {
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
    const auto overlap = [](std::uint32_t k, float low, float high) {
        return std::min(static_cast<float>(k + 1), high) - std::max(static_cast<float>(k), low);
    };
    const auto mean = [&](const auto &texel, std::uint32_t x, std::uint32_t y) {
        const auto rows = share(y, from.height, to.height), columns = share(x, from.width, to.width);
        Spectrum sum{0};
        float total = 0;
        for (std::uint32_t j = rows.first; j < rows.last; ++j)
            for (std::uint32_t i = columns.first; i < columns.last; ++i) {
                const float weight = overlap(j, rows.low, rows.high) * overlap(i, columns.low, columns.high);
                sum += Spectrum(texel(from.first + static_cast<std::int32_t>(j * from.width + i))) * weight;
                total += weight;
            }
        return Spectrum{sum.x / total, sum.y / total, sum.z / total};
    };
    with_texels<float>(*this, [&](const auto &texel) {
        auto i = static_cast<std::size_t>(to.first);
        for (std::uint32_t y = 0; y < to.height; ++y)
            for (std::uint32_t x = 0; x < to.width; ++x, ++i) {
                const Spectrum value = mean(texel, x, y);
                for (std::uint32_t c = 0; c < channels; ++c) switch (type) {
                    case TexelType::byte: put(i, c, encode_byte(value[c], srgb)); break;
                    case TexelType::half: put(i, c, static_cast<Half>(value[c])); break;
                    case TexelType::real: put(i, c, value[c]);
                    }
            }
    });
}

// --- look-ups --------------------------------------------------------------------------------------------

template <class Float>
Rgb<Float> nearest(const Image &image, Vec2<Float> position, WrapMode mode) {
    const auto [width, height, first] = sharpest<Float>(image);
    const Float i = floor(bounded(position.x)), j = floor(bounded(position.y));
    const auto index = to_int(wrap(j, height, mode)) * to_int(width) + to_int(wrap(i, width, mode));
    return with_texels<Float>(image, [&](const auto &texel) {
        return Rgb<Float>(with_border(with_border(texel(index), j, height, mode), i, width, mode));
    });
}
template Rgb<float> nearest(const Image &, Vec2<float>, WrapMode);
template Rgb<WideFloat> nearest(const Image &, Vec2<WideFloat>, WrapMode);

template <class Float>
Rgb<Float> bilinear(const Image &image, const Window<Float> &window, Vec2<Float> position, WrapMode wrap_x,
                    WrapMode wrap_y) {
    return between_texels(image, window, position, wrap_x, wrap_y,
                          [](Float dx, Float dy, const auto &a, const auto &b, const auto &c, const auto &d) {
                              return Rgb<Float>(lerp(dy, lerp(dx, a, b), lerp(dx, c, d)));
                          });
}
template Rgb<float> bilinear(const Image &, const Window<float> &, Vec2<float>, WrapMode, WrapMode);
template Rgb<WideFloat> bilinear(const Image &, const Window<WideFloat> &, Vec2<WideFloat>, WrapMode,
                                 WrapMode);

template <class Float>
std::array<Rgb<Float>, 2> bilinear_gradient(const Image &image, Vec2<Float> position, WrapMode mode) {
    return between_texels(
        image, sharpest<Float>(image), position, mode, mode,
        [](Float dx, Float dy, const auto &a, const auto &b, const auto &c, const auto &d) {
            return std::array{Rgb<Float>(lerp(dy, b - a, d - c)), Rgb<Float>(lerp(dx, c - a, d - b))};
        });
}
template std::array<Rgb<float>, 2> bilinear_gradient(const Image &, Vec2<float>, WrapMode);
template std::array<Rgb<WideFloat>, 2> bilinear_gradient(const Image &, Vec2<WideFloat>, WrapMode);

// --- elliptical averages ---------------------------------------------------------------------------------

namespace {

// exp(-2 r^2), lowered to vanish at r = 1, over r^2 (Heckbert 1989, section 3.5.8); and zero for all beyond.
constexpr int gaussian_steps = 256;
const auto gaussian_weights = [] {
    std::array<float, gaussian_steps + 1> weights{};
    for (std::size_t i = 0; i < gaussian_steps; ++i) {
        const double r_squared = (static_cast<double>(i) + 0.5) / gaussian_steps;
        weights[i] = static_cast<float>(std::exp(-2 * r_squared) - std::exp(-2.0));
    }
    return weights;
}();

// The texels that may be in an ellipse: in each row as many, from where the ellipse may begin. These are a
// third more than are in it; the rectangle around it has many times more where it is long and oblique.
template <class Float>
struct SlantedRows {
    Float x, y;           // of the ellipse's centre
    Float first, count;   // rows
    Float slope;          // of the line through the rows' middles
    Float reach, columns; // half a row, and its number of texels
    Float xx, xy, yy;     // r^2 of an offset is xx dx^2 + xy dx dy + yy dy^2, in steps of the table
};

template <class Float>
SlantedRows<Float> rows_of(const Conic<Float> &ellipse, const Window<Float> &window, Vec2<Float> position,
                           WrapMode mode) {
    const auto brought_back = [&](Float i, Float size) { // by periods, so that most texels need no wrapping
        const Float period = mode == WrapMode::mirror ? 2 * size : size;
        return mode == WrapMode::repeat || mode == WrapMode::mirror ? i - floor(i / period) * period : i;
    };
    const Float x = brought_back(bounded(position.x - 0.5f), window.width),
                y = brought_back(bounded(position.y - 0.5f), window.height);
    const Float determinant = ellipse.xx * ellipse.yy - sqr(ellipse.xy), scale = gaussian_steps / determinant;
    const Float height = sqrt(ellipse.yy), first = -floor(height - y), reach = sqrt(determinant / ellipse.yy);
    return {x,
            y,
            first,
            floor(y + height) - first + 1,
            ellipse.xy / ellipse.yy,
            reach,
            floor(2 * reach) + 1,
            scale * ellipse.yy,
            -2 * scale * ellipse.xy,
            scale * ellipse.xx};
}

template <class Texel>
Spectrum mean_of(const SlantedRows<float> &rows, const Image &image, const Window<float> &window,
                 WrapMode mode, const Texel &texel) {
    const auto [width, height, window_first] = window;
    const std::int32_t row_count = to_int(rows.count), columns = to_int(rows.columns);
    Spectrum sum{0};
    float total = 0;
    for (std::int32_t row = 0; row < row_count; ++row) {
        const float j = rows.first + to_float(row), dy = j - rows.y;
        const float first = -floor(rows.reach - rows.slope * dy - rows.x), dx = first - rows.x;
        float r_squared =
            dx * (rows.xx * dx + rows.xy * dy) + rows.yy * dy * dy; // by its differences along the row
        float step = rows.xx * (2 * dx + 1) + rows.xy * dy;
        const auto add = [&](const auto &value) {
            const auto at = static_cast<std::uint32_t>(to_int(r_squared)); // of what is no number a large one
            const float weight = gaussian_weights[std::min(at, std::uint32_t(gaussian_steps))];
            sum += Spectrum(value) * weight; // zero outside: a branch would cost more, being hard to foresee
            total += weight;
            r_squared += step;
            step += 2 * rows.xx;
        };
        const std::int32_t first_of_row = window_first + to_int(wrap(j, height, mode)) * to_int(width);
        if (first >= 0 && first + rows.columns <= width && (!has_border(mode) || is_inside(j, height))) {
            const std::int32_t begin = first_of_row + to_int(first);
            for (std::int32_t i = begin; i < begin + columns; ++i) add(texel(i));
        } else {
            for (std::int32_t k = 0; k < columns; ++k) {
                const float i = first + to_float(k);
                const auto value = texel(first_of_row + to_int(wrap(i, width, mode)));
                add(with_border(with_border(value, j, height, mode), i, width, mode));
            }
        }
    }
    return total > 0 ? sum / total : bilinear(image, window, {rows.x + 0.5f, rows.y + 0.5f}, mode, mode);
}

float lane_of(float x, int) { return x; }
float lane_of(WideFloat x, int k) { return x[k]; }
std::int32_t lane_of(std::int32_t x, int) { return x; }
std::int32_t lane_of(WideInt x, int k) { return x[k]; }
void set_lane(float &x, int, float value) { x = value; }
void set_lane(WideFloat &x, int k, float value) { x.v[k] = value; }

template <class Float>
SlantedRows<float> lane_of(const SlantedRows<Float> &rows, int k) {
    return {lane_of(rows.x, k),     lane_of(rows.y, k),     lane_of(rows.first, k),   lane_of(rows.count, k),
            lane_of(rows.slope, k), lane_of(rows.reach, k), lane_of(rows.columns, k), lane_of(rows.xx, k),
            lane_of(rows.xy, k),    lane_of(rows.yy, k)};
}

} // namespace

template <class Float>
Rgb<Float> gaussian(const Image &image, const Window<Float> &window, Vec2<Float> position,
                    const Conic<Float> &ellipse, WrapMode mode, BoolOf<Float> active) {
    const SlantedRows<Float> rows = rows_of(ellipse, window, position, mode);
    return with_texels<float>(image, [&](const auto &texel) {
        Rgb<Float> result;
        for (unsigned rest = bits(active); rest; rest &= rest - 1) { // ellipses differ too much for lanes
            const int k = std::countr_zero(rest);
            const Window<float> window_k{lane_of(window.width, k), lane_of(window.height, k),
                                         lane_of(window.first, k)};
            const Spectrum mean = mean_of(lane_of(rows, k), image, window_k, mode, texel);
            set_lane(result.x, k, mean.x), set_lane(result.y, k, mean.y), set_lane(result.z, k, mean.z);
        }
        return result;
    });
}
template Rgb<float> gaussian(const Image &, const Window<float> &, Vec2<float>, const Conic<float> &,
                             WrapMode, bool);
template Rgb<WideFloat> gaussian(const Image &, const Window<WideFloat> &, Vec2<WideFloat>,
                                 const Conic<WideFloat> &, WrapMode, WideBool);

} // namespace lajolla
