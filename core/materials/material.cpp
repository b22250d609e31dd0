#include "materials/material.h"

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

template <class Float>
Vec3<Float> turned(const BumpMap &bump, const TextureReader<Float> &read, const Hit<Float> &hit,
                   const MappedNormal<Float> &normal) {
    const Vec2<Float> slope = read.gradient(bump.map);
    return bumped(normal.n, hit.dp_du, hit.dp_dv, bump.scale * slope.x, bump.scale * slope.y);
}

template <class Float>
Vec3<Float> turned(const NormalMap &map, const TextureReader<Float> &read, const Hit<Float> &,
                   MappedNormal<Float> &normal) {
    const Rgb<Float> value = read(map.normalmap);
    const Frame<Float> frame = frame_along(normal.n, normal.tangent);
    normal.tangent = frame.s;
    const Vec3<Float> t = select(normal.mirrored, -frame.t, frame.t);
    const Vec3<Float> n = frame.s * (map.scale * (2 * value.x - 1)) + t * (map.scale * (2 * value.y - 1)) +
                          frame.n * (2 * value.z - 1);
    const Float squared = length_squared(n);
    return select(squared > 0.0f && isfinite(squared), n * (1 / sqrt(squared)), normal.n);
}

template <class Float>
void turn_by(const auto &map, const TextureReader<Float> &read, const Hit<Float> &hit, const Vec3<Float> &wo,
             MappedNormal<Float> &normal) {
    const Vec3<Float> before = normal.n;
    normal.n = turned(map, read, hit, normal);
    if (map.flip_invalid_normals) normal.n = facing(normal.n, before, wo);
    normal.shadowed |= map.use_shadowing_function;
}

// Two materials; `weight` is that of the second one.
template <class Float>
NullTransmission<Float> blend(Float weight, const NullTransmission<Float> &first,
                              const NullTransmission<Float> &second) {
    return {first.transmittance * (1 - weight) + second.transmittance * weight,
            lerp(weight, first.probability, second.probability)};
}

} // namespace

Materials::Materials(std::span<const Material> materials, SharedVector<Adapter> adapters,
                     std::span<const Bsdf> bsdfs)
    : materials_(materials.begin(), materials.end()), adapters_(std::move(adapters)), bsdfs_(bsdfs) {
    for (const Bsdf &bsdf : bsdfs) bsdf_transmits_.push_back(traits(bsdf).null_transmission);
    std::vector<bool> clear; // adapters of transmissive BSDFs only
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
        has_null_transmission_ |=
            has_null_transmission(material.front) || has_null_transmission(material.back);
    }
}

template <class Float>
void turn(const BumpMap &map, const TextureReader<Float> &read, const Hit<Float> &hit, const Vec3<Float> &wo,
          MappedNormal<Float> &normal) {
    turn_by(map, read, hit, wo, normal);
}
template <class Float>
void turn(const NormalMap &map, const TextureReader<Float> &read, const Hit<Float> &hit,
          const Vec3<Float> &wo, MappedNormal<Float> &normal) {
    turn_by(map, read, hit, wo, normal);
}

template <class Float>
NullTransmission<Float> Materials::null_transmission(MaterialId id, const TextureReader<Float> &read,
                                                     const Hit<Float> &hit, const Vec3<Float> &wo,
                                                     MappedNormal<Float> normal) const {
    if (!has_null_transmission(id)) return {};
    if (id.adapter < 0) {
        const auto [behind, geometric, n] = seen_from(wo, hit.normal, normal);
        const Float z = dot(select(n == geometric, n, with_mirror_image_above(n, geometric, wo)), wo);
        return match(bsdfs_[static_cast<std::size_t>(id.bsdf)],
                     [&](const auto &model) -> NullTransmission<Float> {
                         if constexpr (!is_wide<Float> || IsWide<std::decay_t<decltype(model)>>) {
                             const auto lobe = prepare_lobe<Float>(model, read);
                             if constexpr (requires { lobe.null_transmission(wo); })
                                 return lobe.null_transmission(Vec3<Float>{safe_sqrt(1 - z * z), 0, z});
                         }
                         return {};
                     });
    }
    const auto fraction = [&](const Texture<float> &texture) { return clamp(read(texture), 0.0f, 1.0f); };
    return match(adapter(id), [&](const auto &a) -> NullTransmission<Float> {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>) {
            return blend(fraction(a.weight), null_transmission(a.first, read, hit, wo, normal),
                         null_transmission(a.second, read, hit, wo, normal));
        } else if constexpr (std::is_same_v<Model, Mask>) {
            const NullTransmission<Float> all{Rgb<Float>(1), 1};
            return blend(fraction(a.opacity), all, null_transmission(a.child, read, hit, wo, normal));
        } else {
            turn(a, read, hit, wo, normal);
            return null_transmission(a.child, read, hit, wo, normal);
        }
    });
}

template <class Float>
Float Materials::share_of_second(const Blend &blend, const TextureReader<Float> &read, const Hit<Float> &hit,
                                 const Vec3<Float> &wo, const MappedNormal<Float> &normal) const {
    const Float weight = clamp(read(blend.weight), 0.0f, 1.0f);
    const auto stopped = [&](MaterialId child) {
        return 1 - null_transmission(child, read, hit, wo, normal).probability;
    };
    const Float first = (1 - weight) * stopped(blend.first), second = weight * stopped(blend.second);
    return select(first + second > 0.0f, second / (first + second), Float(0));
}

template NullTransmission<float> Materials::null_transmission(MaterialId, const TextureReader<float> &,
                                                              const Hit<float> &, const Vec3<float> &,
                                                              MappedNormal<float>) const;
template float Materials::share_of_second(const Blend &, const TextureReader<float> &, const Hit<float> &,
                                          const Vec3<float> &, const MappedNormal<float> &) const;
template void turn(const BumpMap &, const TextureReader<float> &, const Hit<float> &, const Vec3<float> &,
                   MappedNormal<float> &);
template void turn(const NormalMap &, const TextureReader<float> &, const Hit<float> &, const Vec3<float> &,
                   MappedNormal<float> &);
template NullTransmission<WideFloat>
Materials::null_transmission(MaterialId, const TextureReader<WideFloat> &, const Hit<WideFloat> &,
                             const Vec3<WideFloat> &, MappedNormal<WideFloat>) const;
template WideFloat Materials::share_of_second(const Blend &, const TextureReader<WideFloat> &,
                                              const Hit<WideFloat> &, const Vec3<WideFloat> &,
                                              const MappedNormal<WideFloat> &) const;
template void turn(const BumpMap &, const TextureReader<WideFloat> &, const Hit<WideFloat> &,
                   const Vec3<WideFloat> &, MappedNormal<WideFloat> &);
template void turn(const NormalMap &, const TextureReader<WideFloat> &, const Hit<WideFloat> &,
                   const Vec3<WideFloat> &, MappedNormal<WideFloat> &);

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
