#include "scene/material.h"

#include <algorithm>
#include <stdexcept>

#include "base/sampler.h"

namespace lajolla {

namespace {

// Trees larger than any that is written by hand; an adapter that is used twice counts twice.
constexpr int deepest = 64, most_leaves = 4096;

template <class F>
void for_each_child(const Adapter &adapter, F &&f) {
    match(adapter, [&](const auto &a) {
        if constexpr (requires { a.child; }) f(a.child);
        else f(a.first), f(a.second);
    });
}

Vec3f turned(const BumpMap &bump, const TextureReader &read, const Hit &hit, const MappedNormal &normal) {
    const Vec2f slope = read.gradient(bump.map);
    return bumped(normal.n, hit.dp_du, hit.dp_dv, bump.scale * slope.x, bump.scale * slope.y);
}

Vec3f turned(const NormalMap &map, const TextureReader &read, const Hit &, MappedNormal &normal) {
    const Spectrum value = read(map.normalmap);
    const Frame frame = frame_along(normal.n, normal.tangent);
    normal.tangent = frame.s;
    const Vec3f t = normal.mirrored ? -frame.t : frame.t;
    const Vec3f n = frame.s * (map.scale * (2 * value.x - 1)) + t * (map.scale * (2 * value.y - 1)) +
                    frame.n * (2 * value.z - 1);
    const float squared = length_squared(n);
    return squared > 0 && std::isfinite(squared) ? n * (1 / std::sqrt(squared)) : normal.n;
}

void turn(const auto &map, const TextureReader &read, const Hit &hit, const Vec3f &wo, MappedNormal &normal) {
    const Vec3f before = normal.n;
    normal.n = turned(map, read, hit, normal);
    if (map.flip_invalid_normals) normal.n = facing(normal.n, before, wo);
    normal.turned_by_maps = true;
    normal.shadowed |= map.use_shadowing_function;
}

// Two materials, the second of which has the share `weight`.
Passage blend(float weight, const Passage &first, const Passage &second) {
    return {first.transmitted * (1 - weight) + second.transmitted * weight,
            lerp(weight, first.probability, second.probability)};
}

} // namespace

Materials::Materials(std::vector<Material> materials, std::vector<Adapter> adapters,
                     std::span<const Bsdf> bsdfs)
    : materials_(std::move(materials)), adapters_(std::move(adapters)), bsdfs_(bsdfs) {
    for (const Bsdf &bsdf : bsdfs) bsdf_passes_.push_back(lajolla::lets_pass(bsdf));
    std::vector<bool> clear; // adapters of BSDFs that light passes through, and no others
    const auto is_clear = [&](MaterialId id) {
        if (id.adapter >= 0) return bool(clear[static_cast<std::size_t>(id.adapter)]);
        return id.bsdf >= 0 && is_transmissive(bsdfs[static_cast<std::size_t>(id.bsdf)]);
    };
    std::vector<int> depths;
    for (const Adapter &adapter : adapters_) {
        const auto *mask = std::get_if<Mask>(&adapter);
        bool passes = mask && !(mask->opacity == Texture<float>(1));
        bool all_clear = true;
        int depth = 0, count = 0;
        for_each_child(adapter, [&](MaterialId child) {
            const auto index = static_cast<std::size_t>(std::max(child.adapter, 0));
            passes |= lets_pass(child);
            all_clear &= is_clear(child);
            depth = std::max(depth, child.adapter >= 0 ? depths[index] : 0);
            count += child.adapter >= 0 ? adapter_leaves_[index] : 1;
        });
        adapter_passes_.push_back(passes);
        clear.push_back(all_clear);
        depths.push_back(depth + 1);
        adapter_leaves_.push_back(count);
        if (depth + 1 > deepest) throw std::invalid_argument("materials are nested more than 64 deep");
        if (count > most_leaves)
            throw std::invalid_argument("a material is a mixture of more than 4096 materials");
    }
    for (Material &material : materials_) {
        if (is_clear(material.front)) material.back = {};
        has_passages_ |= lets_pass(material.front) || lets_pass(material.back);
    }
}

Passage Materials::passage(MaterialId id, const TextureReader &read, const Hit &hit, const Vec3f &wo,
                           MappedNormal normal) const {
    if (!lets_pass(id)) return {};
    if (id.adapter < 0) {
        const auto [behind, geometric, n] = seen_from(wo, hit.normal, normal);
        const float z = dot(n == geometric ? n : with_mirror_image_above(n, geometric, wo), wo);
        return match(bsdfs_[static_cast<std::size_t>(id.bsdf)], [&](const auto &model) -> Passage {
            if constexpr (requires { model.prepare(read).straight(wo); })
                return model.prepare(read).straight({safe_sqrt(1 - z * z), 0, z});
            else return {};
        });
    }
    return match(adapter(id), [&](const auto &a) -> Passage {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>)
            return blend(std::clamp(read(a.weight), 0.0f, 1.0f), passage(a.first, read, hit, wo, normal),
                         passage(a.second, read, hit, wo, normal));
        else if constexpr (std::is_same_v<Model, Mask>)
            return blend(std::clamp(read(a.opacity), 0.0f, 1.0f), {Spectrum(1), 1},
                         passage(a.child, read, hit, wo, normal));
        else {
            turn(a, read, hit, wo, normal);
            return passage(a.child, read, hit, wo, normal);
        }
    });
}

float Materials::share_of_second(const Blend &blend, const TextureReader &read, const Hit &hit,
                                 const Vec3f &wo, const MappedNormal &normal) const {
    const float weight = std::clamp(read(blend.weight), 0.0f, 1.0f);
    const auto stopped = [&](MaterialId child) {
        return 1 - passage(child, read, hit, wo, normal).probability;
    };
    const float first = (1 - weight) * stopped(blend.first), second = weight * stopped(blend.second);
    return first + second > 0 ? second / (first + second) : 0;
}

std::int32_t Materials::choose(MaterialId id, const TextureReader &read, const Hit &hit, const Vec3f &wo,
                               float u, MappedNormal &normal) const {
    while (id.adapter >= 0)
        match(adapter(id), [&](const auto &a) {
            using Model = std::decay_t<decltype(a)>;
            if constexpr (std::is_same_v<Model, Blend>) {
                id = passes(share_of_second(a, read, hit, wo, normal), u) ? a.second : a.first;
            } else {
                if constexpr (!std::is_same_v<Model, Mask>) turn(a, read, hit, wo, normal);
                id = a.child;
            }
        });
    return id.bsdf;
}

SmallBlend Materials::leaves(MaterialId id, const TextureReader &read, const Hit &hit, const Vec3f &wo,
                             const MappedNormal &normal) const {
    SmallBlend result;
    add_leaves(id, read, hit, wo, normal, 1, result);
    return result;
}

void Materials::add_leaves(MaterialId id, const TextureReader &read, const Hit &hit, const Vec3f &wo,
                           MappedNormal normal, float share, SmallBlend &leaves) const {
    if (share == 0) return;
    if (id.adapter < 0) {
        leaves.leaf[static_cast<std::size_t>(leaves.count++)] = {id.bsdf, normal, share};
        return;
    }
    match(adapter(id), [&](const auto &a) {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>) {
            const float second = share_of_second(a, read, hit, wo, normal);
            add_leaves(a.first, read, hit, wo, normal, share * (1 - second), leaves);
            add_leaves(a.second, read, hit, wo, normal, share * second, leaves);
        } else {
            if constexpr (!std::is_same_v<Model, Mask>) turn(a, read, hit, wo, normal);
            add_leaves(a.child, read, hit, wo, normal, share, leaves);
        }
    });
}

std::int32_t Materials::first_bsdf(MaterialId id) const {
    while (id.adapter >= 0) {
        MaterialId first;
        bool found = false;
        for_each_child(adapter(id), [&](MaterialId child) {
            if (!found) first = child;
            found = true;
        });
        id = first;
    }
    return id.bsdf;
}

} // namespace lajolla
