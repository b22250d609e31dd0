#include "scene/image.h"

#include <array>

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

} // namespace

const float *byte_decoding(bool srgb) {
    static const Table encoded = make_table(true), linear = make_table(false);
    return (srgb ? encoded : linear).data();
}

std::size_t Image::bytes() const {
    return match(texels, [](const auto &values) { return values.size() * sizeof(values[0]); });
}

Spectrum Image::texel(std::uint32_t x, std::uint32_t y) const {
    const std::size_t first = (static_cast<std::size_t>(y) * width + x) * channels;
    return match(texels, [&](const auto &values) {
        const auto decode = [&](std::size_t i) {
            if constexpr (std::is_same_v<std::decay_t<decltype(values[0])>, std::uint8_t>)
                return byte_decoding(srgb)[values[i]];
            else return static_cast<float>(values[i]);
        };
        return channels == 1 ? Spectrum(decode(first))
                             : Spectrum(decode(first), decode(first + 1), decode(first + 2));
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
