#include "media/volumes.h"

#include <stdexcept>

namespace lajolla {

namespace {

bool in_unit_cube(Vec3f q) { return q.x >= 0 && q.x <= 1 && q.y >= 0 && q.y <= 1 && q.z >= 0 && q.z <= 1; }

} // namespace

void GridVolume::build() {
    if (!grid) throw std::invalid_argument("a gridvolume needs a grid");
    const auto inverted = inverse(to_world);
    if (!inverted) throw std::invalid_argument("\"to_world\" flattens the volume");
    world_to_cube_ = *inverted;
}

Vec3f GridVolume::intervals() const {
    const auto count = [&](std::uint32_t size) {
        return std::max(static_cast<float>(size) - (align_corners ? 1.0f : 0.0f), 1.0f);
    };
    return {count(grid->width), count(grid->height), count(grid->depth)};
}

void GridVolume::look_up(Vec3f q, std::span<float> result) const {
    const bool constant_outside = wrap_mode == WrapMode::zero || wrap_mode == WrapMode::one;
    if (constant_outside && !in_unit_cube(q))
        return std::fill(result.begin(), result.end(), wrap_mode == WrapMode::one ? 1.0f : 0.0f);
    const Vec3f offset(align_corners ? 0.0f : -0.5f);
    lajolla::look_up(*grid, q * intervals() + offset, filter_type, wrap_mode, result);
}

Spectrum GridVolume::at(Vec3f q) const {
    std::array<float, 3> v{};
    if (grid->channels == 3) {
        look_up(q, v);
        return {v[0], v[1], v[2]};
    }
    look_up(q, std::span(v).first(1));
    return Spectrum(v[0]);
}

Spectrum GridVolume::evaluate(Vec3f p) const { return at(world_to_cube_.point(p)); }

Spectrum GridVolume::evaluate_inside(Vec3f p) const {
    const Vec3f q = world_to_cube_.point(p);
    return in_unit_cube(q) ? at(q) : Spectrum(0);
}

float GridVolume::evaluate_mean(Vec3f p) const { return mean(evaluate(p)); }

SymmetricMatrix GridVolume::evaluate_matrix(Vec3f p) const {
    std::array<float, 6> v{};
    look_up(world_to_cube_.point(p), v);
    return {v[0], v[1], v[2], v[3], v[4], v[5]};
}

} // namespace lajolla
