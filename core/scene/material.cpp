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

Vec3f turned(const BumpMap &bump, const TextureReader<float> &read, const Hit<float> &hit, const MappedNormal<float> &normal) {
    const Vec2f slope = read.gradient(bump.map);
    return bumped(normal.n, hit.dp_du, hit.dp_dv, bump.scale * slope.x, bump.scale * slope.y);
}

Vec3f turned(const NormalMap &map, const TextureReader<float> &read, const Hit<float> &, MappedNormal<float> &normal) {
    const Spectrum value = read(map.normalmap);
    const Frame<float> frame = frame_along(normal.n, normal.tangent);
    normal.tangent = frame.s;
    const Vec3f t = normal.mirrored ? -frame.t : frame.t;
    const Vec3f n = frame.s * (map.scale * (2 * value.x - 1)) + t * (map.scale * (2 * value.y - 1)) +
                    frame.n * (2 * value.z - 1);
    const float squared = length_squared(n);
    return squared > 0 && isfinite(squared) ? n * (1 / sqrt(squared)) : normal.n;
}

void turn(const auto &map, const TextureReader<float> &read, const Hit<float> &hit, const Vec3f &wo, MappedNormal<float> &normal) {
    const Vec3f before = normal.n;
    normal.n = turned(map, read, hit, normal);
    if (map.flip_invalid_normals) normal.n = facing(normal.n, before, wo);
    normal.turned_by_maps = true;
    normal.shadowed |= map.use_shadowing_function;
}

// Two materials, the second of which has the share `weight`.
NullTransmission<float> blend(float weight, const NullTransmission<float> &first, const NullTransmission<float> &second) {
    return {first.transmittance * (1 - weight) + second.transmittance * weight,
            lerp(weight, first.probability, second.probability)};
}

} // namespace

Materials::Materials(std::vector<Material> materials, std::vector<Adapter> adapters,
                     std::span<const Bsdf> bsdfs)
    : materials_(std::move(materials)), adapters_(std::move(adapters)), bsdfs_(bsdfs) {
    for (const Bsdf &bsdf : bsdfs) bsdf_transmits_.push_back(traits(bsdf).null_transmission);
    std::vector<bool> clear; // adapters of BSDFs that light passes through, and no others
    const auto is_clear = [&](MaterialId id) {
        if (id.adapter >= 0) return bool(clear[static_cast<std::size_t>(id.adapter)]);
        return id.bsdf >= 0 && traits(bsdfs[static_cast<std::size_t>(id.bsdf)]).transmissive;
    };
    std::vector<int> depths;
    for (const Adapter &adapter : adapters_) {
        const auto *mask = std::get_if<Mask>(&adapter);
        bool passes = mask && !(mask->opacity == Texture<float>(1));
        bool all_clear = true;
        int depth = 0, count = 0;
        for_each_child(adapter, [&](MaterialId child) {
            const auto index = static_cast<std::size_t>(std::max(child.adapter, 0));
            passes |= has_null_transmission(child);
            all_clear &= is_clear(child);
            depth = std::max(depth, child.adapter >= 0 ? depths[index] : 0);
            count += child.adapter >= 0 ? adapter_leaves_[index] : 1;
        });
        adapter_transmits_.push_back(passes);
        clear.push_back(all_clear);
        depths.push_back(depth + 1);
        adapter_leaves_.push_back(count);
        if (depth + 1 > deepest) throw std::invalid_argument("materials are nested more than 64 deep");
        if (count > most_leaves)
            throw std::invalid_argument("a material is a mixture of more than 4096 materials");
    }
    for (Material &material : materials_) {
        if (is_clear(material.front)) material.back = {};
        has_null_transmission_ |= has_null_transmission(material.front) || has_null_transmission(material.back);
    }
}

NullTransmission<float> Materials::null_transmission(MaterialId id, const TextureReader<float> &read, const Hit<float> &hit, const Vec3f &wo,
                           MappedNormal<float> normal) const {
    if (!has_null_transmission(id)) return {};
    if (id.adapter < 0) {
        const auto [behind, geometric, n] = seen_from(wo, hit.normal, normal);
        const float z = dot(n == geometric ? n : with_mirror_image_above(n, geometric, wo), wo);
        return match(bsdfs_[static_cast<std::size_t>(id.bsdf)], [&](const auto &model) -> NullTransmission<float> {
            const auto lobe = prepare_lobe<float>(model, read);
            if constexpr (requires { lobe.null_transmission(wo); })
                return lobe.null_transmission(Vec3f{safe_sqrt(1 - z * z), 0, z});
            else return {};
        });
    }
    return match(adapter(id), [&](const auto &a) -> NullTransmission<float> {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>)
            return blend(clamp(read(a.weight), 0.0f, 1.0f), null_transmission(a.first, read, hit, wo, normal),
                         null_transmission(a.second, read, hit, wo, normal));
        else if constexpr (std::is_same_v<Model, Mask>)
            return blend(clamp(read(a.opacity), 0.0f, 1.0f), {Spectrum(1), 1},
                         null_transmission(a.child, read, hit, wo, normal));
        else {
            turn(a, read, hit, wo, normal);
            return null_transmission(a.child, read, hit, wo, normal);
        }
    });
}

float Materials::share_of_second(const Blend &blend, const TextureReader<float> &read, const Hit<float> &hit,
                                 const Vec3f &wo, const MappedNormal<float> &normal) const {
    const float weight = clamp(read(blend.weight), 0.0f, 1.0f);
    const auto stopped = [&](MaterialId child) {
        return 1 - null_transmission(child, read, hit, wo, normal).probability;
    };
    const float first = (1 - weight) * stopped(blend.first), second = weight * stopped(blend.second);
    return first + second > 0 ? second / (first + second) : 0;
}

std::int32_t Materials::choose(MaterialId id, const TextureReader<float> &read, const Hit<float> &hit, const Vec3f &wo,
                               float u, MappedNormal<float> &normal) const {
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

SmallBlend Materials::leaves(MaterialId id, const TextureReader<float> &read, const Hit<float> &hit, const Vec3f &wo,
                             const MappedNormal<float> &normal) const {
    SmallBlend result;
    add_leaves(id, read, hit, wo, normal, 1, result);
    return result;
}

void Materials::add_leaves(MaterialId id, const TextureReader<float> &read, const Hit<float> &hit, const Vec3f &wo,
                           MappedNormal<float> normal, float share, SmallBlend &leaves) const {
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
