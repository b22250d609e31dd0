#pragma once
// The material of a shape: a tree whose leaves are BSDFs. Its inner nodes, the adapters, select between
// materials, mask, or change the normal. They are not BSDFs, so lobes stay small for trees of any depth.

#include <array>
#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "base/fields.h"
#include "base/sampler.h"
#include "base/shared_vector.h"
#include "base/texture.h"
#include "materials/normals.h"
#include "scatter/bsdfs.h"
#include "textures/textures.h"

namespace lajolla {

// The content of a slot or an adapter: a BSDF, an adapter, or neither, which is black.
struct MaterialId {
    std::int32_t bsdf = -1, adapter = -1;
    friend constexpr bool operator==(const MaterialId &, const MaterialId &) = default;
};

// What is done where vertex normals and triangles disagree about which light reaches a surface
// (docs/shading-normals.md).
enum class Terminator { none, hanika, chiang };
constexpr auto choices(Terminator) { return std::array{"none", "hanika", "chiang"}; }

// One tree for each side. Without a tree for the back, that of the front serves both: its transmissive BSDFs
// are visible from behind, its others black. A tree of transmissive BSDFs alone never has another for the
// back.
struct Material {
    static constexpr const char *name = "material";
    static constexpr const char *doc = "What a shape looks like.";
    MaterialId front;
    MaterialId back; // for the back, in a flipped frame
    Terminator terminator = Terminator::none;

    static constexpr auto fields() {
        return std::tuple(
            field("front", &Material::front, "the front"), field("back", &Material::back, "the back"),
            field("terminator", &Material::terminator,
                  "shadows on meshes with vertex normals: hanika moves the start of rays, chiang darkens"));
    }
};

struct Blend {
    static constexpr const char *name = "blendbsdf";
    static constexpr const char *doc = "A mixture of two materials.";
    Texture<float> weight{0.5f};
    MaterialId first, second;

    static constexpr auto fields() {
        return std::tuple(field("weight", &Blend::weight, "weight of the second material").range(0, 1),
                          field("first", &Blend::first, "where the weight is 0"),
                          field("second", &Blend::second, "where the weight is 1"));
    }
};

struct Mask {
    static constexpr const char *name = "mask";
    static constexpr const char *doc = "Opacity mask.";
    Texture<float> opacity{0.5f};
    MaterialId child;

    static constexpr auto fields() {
        return std::tuple(field("opacity", &Mask::opacity, "0 is transparent, 1 is opaque").range(0, 1),
                          field("child", &Mask::child, "the material"));
    }
};

struct BumpMap {
    static constexpr const char *name = "bumpmap";
    static constexpr const char *doc = "Bump mapping: shading normals of a displaced surface.";
    Texture<float> map{0};
    float scale = 1;
    bool flip_invalid_normals = true, use_shadowing_function = true;
    MaterialId child;

    static constexpr auto fields() {
        return std::tuple(field("map", &BumpMap::map, "displacement along the normal, in units of the scene"),
                          field("scale", &BumpMap::scale, "factor of the displacement"),
                          field("flip_invalid_normals", &BumpMap::flip_invalid_normals, flip_doc),
                          field("use_shadowing_function", &BumpMap::use_shadowing_function, shadowing_doc),
                          field("child", &BumpMap::child, "the material"));
    }
    static constexpr const char *flip_doc = "flip normals that face away from the viewer";
    static constexpr const char *shadowing_doc = "attenuate light that bumps would block";
};

struct NormalMap {
    static constexpr const char *name = "normalmap";
    static constexpr const char *doc = "Normal mapping: shading normals from a texture.";
    Texture<Spectrum> normalmap{Spectrum(0.5f, 0.5f, 1)};
    float scale = 1;
    bool flip_invalid_normals = true, use_shadowing_function = true;
    MaterialId child;

    static constexpr auto fields() {
        return std::tuple(
            field("normalmap", &NormalMap::normalmap, "(normal + 1) / 2 along dp/du, across, and outwards"),
            field("scale", &NormalMap::scale, "factor of the parts along the surface"),
            field("flip_invalid_normals", &NormalMap::flip_invalid_normals, BumpMap::flip_doc),
            field("use_shadowing_function", &NormalMap::use_shadowing_function, BumpMap::shadowing_doc),
            field("child", &NormalMap::child, "the material"));
    }
};

using Adapter = std::variant<Blend, Mask, BumpMap, NormalMap>;

// The shading normal of a map at a hit, seen from `wo`.
template <class Float>
void turn(const BumpMap &map, const TextureReader<Float> &read, const Hit<Float> &hit, const Vec3<Float> &wo,
          MappedNormal<Float> &normal);
template <class Float>
void turn(const NormalMap &map, const TextureReader<Float> &read, const Hit<Float> &hit,
          const Vec3<Float> &wo, MappedNormal<Float> &normal);

// The materials of a scene.
class Materials {
public:
    Materials() = default;
    // Ids must be valid, adapters may only contain earlier adapters, and `bsdfs` must outlive this. Throws
    // std::invalid_argument for trees that are too large.
    Materials(std::span<const Material> materials, SharedVector<Adapter> adapters,
              std::span<const Bsdf> bsdfs);

    const Material &operator[](std::int32_t id) const { return materials_[static_cast<std::size_t>(id)]; }
    // How the material of a hit treats the terminator; -1 for no material.
    Terminator terminator(std::int32_t id) const {
        return id < 0 ? Terminator::none : (*this)[id].terminator;
    }

    // Whether light passes straight through any material.
    bool has_null_transmission() const { return has_null_transmission_; }

    // The light that passes straight through, seen from `wo`. `normal` is the one without maps.
    template <class Float>
    NullTransmission<Float> null_transmission(MaterialId id, const TextureReader<Float> &read,
                                              const Hit<Float> &hit, const Vec3<Float> &wo,
                                              MappedNormal<Float> normal) const;

    // For light that does not pass straight through, selects a BSDF (-1 is black) in proportion to the light
    // it intercepts, and calls f(bsdf, normal, chosen) for each selected one. Maps on the way to it change
    // the normal.
    template <class Float, class F>
    void choose(MaterialId id, const TextureReader<Float> &read, const Hit<Float> &hit, const Vec3<Float> &wo,
                Float u, MappedNormal<Float> normal, BoolOf<Float> active, F &&f) const;

    static constexpr int most_lit_leaves = 4;
    // Whether a tree mixes BSDFs, and few enough to evaluate each of them.
    bool is_small_blend(MaterialId id) const {
        if (id.adapter < 0) return false;
        const int leaves = adapter_leaves_[static_cast<std::size_t>(id.adapter)];
        return leaves > 1 && leaves <= most_lit_leaves;
    }
    // Calls f(bsdf, normal, share) for all BSDFs that choose() may select; multiplies their probability by
    // `share`.
    template <class Float, class F>
    void for_each_leaf(MaterialId id, const TextureReader<Float> &read, const Hit<Float> &hit,
                       const Vec3<Float> &wo, MappedNormal<Float> normal, Float share, F &&f) const;

    // Calls f(bsdf) for all BSDFs of a tree.
    template <class F>
    void for_each_bsdf(MaterialId id, F &&f) const;

    // Whether light may pass straight through.
    bool has_null_transmission(MaterialId id) const {
        return id.adapter >= 0 ? adapter_transmits_[static_cast<std::size_t>(id.adapter)]
                               : id.bsdf >= 0 && bsdf_transmits_[static_cast<std::size_t>(id.bsdf)];
    }

    // The first BSDF in the tree.
    std::int32_t first_bsdf(MaterialId id) const;

private:
    const Adapter &adapter(MaterialId id) const { return adapters_[static_cast<std::size_t>(id.adapter)]; }
    // The fraction of the light intercepted by a blend that its second material intercepts.
    template <class Float>
    Float share_of_second(const Blend &blend, const TextureReader<Float> &read, const Hit<Float> &hit,
                          const Vec3<Float> &wo, const MappedNormal<Float> &normal) const;

    std::vector<Material> materials_;
    SharedVector<Adapter> adapters_;
    std::span<const Bsdf> bsdfs_;
    std::vector<bool> bsdf_transmits_, adapter_transmits_;
    std::vector<int> adapter_leaves_;
    bool has_null_transmission_ = false;
};

template <class Float, class F>
void Materials::choose(MaterialId id, const TextureReader<Float> &read, const Hit<Float> &hit,
                       const Vec3<Float> &wo, Float u, MappedNormal<Float> normal, BoolOf<Float> active,
                       F &&f) const {
    if (!any(active)) return;
    if (id.adapter < 0) return f(id.bsdf, normal, active);
    match(adapter(id), [&](const auto &a) {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>) {
            const auto second = passes(share_of_second(a, read, hit, wo, normal), u);
            choose(a.first, read, hit, wo, u, normal, active && !second, f);
            choose(a.second, read, hit, wo, u, normal, active && second, f);
        } else {
            if constexpr (!std::is_same_v<Model, Mask>) turn(a, read, hit, wo, normal);
            choose(a.child, read, hit, wo, u, normal, active, f);
        }
    });
}

template <class Float, class F>
void Materials::for_each_leaf(MaterialId id, const TextureReader<Float> &read, const Hit<Float> &hit,
                              const Vec3<Float> &wo, MappedNormal<Float> normal, Float share, F &&f) const {
    if (!any(share != 0.0f)) return;
    if (id.adapter < 0) return f(id.bsdf, normal, share);
    match(adapter(id), [&](const auto &a) {
        using Model = std::decay_t<decltype(a)>;
        if constexpr (std::is_same_v<Model, Blend>) {
            const Float second = share_of_second(a, read, hit, wo, normal);
            for_each_leaf(a.first, read, hit, wo, normal, share * (1 - second), f);
            for_each_leaf(a.second, read, hit, wo, normal, share * second, f);
        } else {
            if constexpr (!std::is_same_v<Model, Mask>) turn(a, read, hit, wo, normal);
            for_each_leaf(a.child, read, hit, wo, normal, share, f);
        }
    });
}

template <class F>
void Materials::for_each_bsdf(MaterialId id, F &&f) const {
    if (id.adapter < 0) return f(id.bsdf);
    match(adapter(id), [&](const auto &a) {
        if constexpr (requires { a.child; }) for_each_bsdf(a.child, f);
        else for_each_bsdf(a.first, f), for_each_bsdf(a.second, f);
    });
}

} // namespace lajolla
