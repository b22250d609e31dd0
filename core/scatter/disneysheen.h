#pragma once

#include "scatter/disneydiffuse.h"

namespace lajolla {

struct DisneySheen {
    static constexpr const char *name = "disneysheen";
    static constexpr const char *doc = "Sheen of cloth, part of disneybsdf (Burley 2012, section 5.5).";
    Texture<Spectrum> base_color{Spectrum(0.5f)};
    Texture<float> sheen_tint{0.5f};

    static constexpr auto fields() {
        return std::tuple(
            field("base_color", &DisneySheen::base_color, "its hue tints the sheen").range(0, 1),
            field("sheen_tint", &DisneySheen::sheen_tint, "0 is white, 1 has the hue of the base color")
                .range(0, 1));
    }

    BsdfTraits traits() const { return {.diffuse_colour = &base_color}; }

    template <class Float>
    using Lobe = DisneyDiffuse::Lobe<Float>;

    template <class Float>
    Lobe<Float> prepare(const auto &read) const {
        const Rgb<Float> base = disney::colour(read(base_color));
        return {.sheen = disney::Tint(base, disney::fraction(read(sheen_tint)))(base)};
    }
};

} // namespace lajolla
