#pragma once
// A handle to a textured parameter: a constant, or the id of a texture that lives in the scene. Models hold
// handles and read them through the function that their prepare() is given, so they know nothing about
// images.

#include <cstdint>

#include "base/vec.h"

namespace lajolla {

template <class T>
struct Texture {
    T constant{};
    std::int32_t id = -1; // index into the scene's textures, -1 for a constant

    constexpr Texture() = default;
    constexpr Texture(T value) : constant(value) {}
    constexpr bool is_constant() const { return id < 0; }
    friend constexpr bool operator==(const Texture &, const Texture &) = default;
};

} // namespace lajolla
