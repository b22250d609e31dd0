#include "scene/scene.h"

#include <algorithm>
#include <bit>

namespace lajolla {

namespace {

Bounds bounds_of(const Shape &shape) {
    return match(shape, [](const auto &s) { return s.bounds(); });
}

BoundingSphere sphere_around(const SceneParts &parts) {
    const Bounds box = bounds_of(parts);
    if (box.empty()) return {};
    return {(box.low + box.high) * 0.5f, std::max(length(box.high - box.low) / 2, 1e-15f)};
}

HitNeeds needs_of(const SceneParts &parts, std::span<const BsdfTraits> traits, bool reads_footprints) {
    HitNeeds needs{!parts.textures.empty(), reads_footprints, reads_footprints};
    for (const Material &material : parts.materials) needs.lift |= material.terminator == Terminator::hanika;
    for (const BsdfTraits &each : traits) needs.tangents |= each.anisotropic;
    for (const Adapter &adapter : parts.adapters)
        needs.tangents |=
            std::holds_alternative<BumpMap>(adapter) || std::holds_alternative<NormalMap>(adapter);
    for (const TextureModel &texture : parts.textures)
        needs.curvature |= std::holds_alternative<CurvatureTexture>(texture);
    needs.tangents |= needs.curvature;
    return needs;
}

MeshArrays arrays_of(const Shape &shape) {
    const auto *mesh = std::get_if<TriangleMesh>(&shape);
    if (!mesh) return {};
    const Mesh &m = *mesh->mesh;
    return {m.triangles.data(), m.positions.data(), mesh->has_normals() ? m.normals.data() : nullptr,
            m.uvs.empty() ? nullptr : m.uvs.data(), mesh->flip_normals};
}

} // namespace

Bounds bounds_of(const SceneParts &parts) {
    std::vector<bool> is_member(parts.shapes.size(), false);
    std::vector<Bounds> groups;
    for (const Group &group : parts.groups) {
        Bounds &box = groups.emplace_back();
        for (const std::uint32_t id : group) {
            box.extend(bounds_of(parts.shapes[id]));
            is_member[id] = true;
        }
    }
    Bounds box;
    for (std::size_t id = 0; id < parts.shapes.size(); ++id)
        if (!is_member[id]) box.extend(bounds_of(parts.shapes[id]));
    for (const Instance &instance : parts.instances)
        box.extend(instance.placed(groups[static_cast<std::size_t>(instance.group)]));
    return box;
}

// Sets the shapes of area lights, and prepares both for sampling.
void Scene::connect_lights(bool prepare_shapes) {
    std::vector<Light> &lights = parts_.lights.edit();
    std::vector<bool> has_shape(lights.size());
    for (std::size_t i = 0; i < parts_.shapes.size(); ++i) {
        const std::int32_t emitter = parts_.slots[i].emitter;
        if (emitter < 0) continue;
        auto *light = std::get_if<AreaLight>(&lights[static_cast<std::size_t>(emitter)]);
        if (!light) throw std::invalid_argument("only area emitters can be attached to shapes");
        if (has_shape[static_cast<std::size_t>(emitter)])
            throw std::invalid_argument("two shapes share one area emitter");
        has_shape[static_cast<std::size_t>(emitter)] = true;
        if (prepare_shapes) match(parts_.shapes.edit()[i], [](auto &shape) { shape.prepare_sampling(); });
        light->shape = &parts_.shapes[i];
    }
    for (const Group &group : parts_.groups)
        for (const std::uint32_t id : group)
            if (parts_.slots[id].emitter >= 0)
                throw std::invalid_argument("a shape in a group cannot be a light");
    for (std::size_t i = 0; i < lights.size(); ++i)
        if (auto *area = std::get_if<AreaLight>(&lights[i])) {
            if (!has_shape[i]) throw std::invalid_argument("an area emitter needs a shape");
            area->prepare_sampling(parts_.textures);
        }
}

// What textures and materials are like.
void Scene::describe_looks() {
    std::vector<BsdfTraits> all;
    for (const Bsdf &bsdf : parts_.bsdfs) all.push_back(traits(bsdf));
    bsdf_traits_ = std::move(all);
    for (const TextureModel &texture : parts_.textures)
        match(texture, [&](const auto &model) {
            if constexpr (requires { model.reads_footprints(); })
                reads_footprints_ |= model.reads_footprints();
        });
    materials_ = std::make_shared<const Materials>(parts_.materials, parts_.adapters, parts_.bsdfs);
    for (const Adapter &adapter : parts_.adapters) has_blends_ |= std::holds_alternative<Blend>(adapter);
    needs_ = needs_of(parts_, bsdf_traits_, reads_footprints_);
}

Scene::Scene(SceneParts parts, const Scene *before) : parts_(std::move(parts)), filter_(parts_.filter) {
    using Parts = SceneParts;
    const auto same = [&](auto... members) {
        return before && (... && (parts_.*members).shares(before->parts_.*members));
    };
    if (!same(&Parts::shapes, &Parts::lights, &Parts::textures)) connect_lights(!same(&Parts::shapes));
    if (same(&Parts::textures, &Parts::bsdfs, &Parts::adapters, &Parts::materials)) {
        bsdf_traits_ = before->bsdf_traits_, materials_ = before->materials_, needs_ = before->needs_;
        reads_footprints_ = before->reads_footprints_, has_blends_ = before->has_blends_;
    } else {
        describe_looks();
    }
    if (same(&Parts::shapes, &Parts::groups, &Parts::instances)) {
        meshes_ = before->meshes_, accel_ = before->accel_, bounding_sphere_ = before->bounding_sphere_;
    } else {
        std::vector<MeshArrays> arrays;
        for (const Shape &shape : parts_.shapes) arrays.push_back(arrays_of(shape));
        meshes_ = std::move(arrays);
        accel_ = std::make_shared<const Accel>(parts_.shapes, parts_.groups, parts_.instances, parts_.robust,
                                               before ? before->accel_.get() : nullptr);
        bounding_sphere_ = sphere_around(parts_);
    }
    const auto note_role = [&](const Compositing &each) {
        has_camera_roles_ |= each.role() != CameraRole::object;
        has_catchers_ |= each.role() == CameraRole::catcher;
    };
    std::ranges::for_each(parts_.compositing, note_role);
    std::ranges::for_each(parts_.instances, note_role);
    const CameraFit fit{parts_.film.aspect(), static_cast<float>(parts_.film.width), bounding_sphere_};
    match(parts_.camera, [&](auto &camera) {
        camera.build(fit);
        to_camera_ = inverse(camera.to_world).value_or(Transform{});
    });
    if (same(&Parts::shapes, &Parts::instances, &Parts::lights, &Parts::textures)) picker_ = before->picker_;
    else picker_ = std::make_shared<const LightPicker>(parts_.lights, parts_.textures, bounding_sphere_);
}

Hit<float> Scene::hit(const Ray<float> &ray, const RayHit &found, const Footprint<float> &footprint,
                      const HitNeeds &needs) const {
    Hit<float> result = hit(ray, found, needs);
    result.footprint.move(footprint, ray.direction, found.distance, result.normal);
    return result;
}

Hit<float> Scene::hit(const Ray<float> &ray, const RayHit &found, const HitNeeds &needs) const {
    const ShapeSlot &slot = parts_.slots[found.shape];
    Hit<float> hit;
    hit.distance = found.distance;
    hit.shape = static_cast<std::int32_t>(found.shape);
    hit.primitive = static_cast<std::int32_t>(found.primitive);
    hit.instance = static_cast<std::int32_t>(found.instance);
    hit.material = slot.material;
    hit.emitter = slot.emitter;
    hit.interior = slot.interior;
    hit.exterior = slot.exterior;
    HitNeeds own = needs;
    own.lift = needs.lift && materials_->terminator(slot.material) == Terminator::hanika;
    if (found.instance != RayHit::no_instance) [[unlikely]]
        fill_in_instance(ray, found, own, hit);
    else match(parts_.shapes[found.shape], [&](const auto &shape) { shape.fill(ray, found, own, hit); });
    return hit;
}

void Scene::fill_in_instance(const Ray<float> &ray, const RayHit &found, const HitNeeds &needs,
                             Hit<float> &hit) const {
    const Instance &instance = parts_.instances[found.instance];
    const Ray<float> inside = instance.in_group(ray);
    match(parts_.shapes[found.shape], [&](const auto &shape) { shape.fill(inside, found, needs, hit); });
    instance.place(hit);
}

// Triangles that are not in instances are filled in by all lanes at once, the rest one after the other.
Hit<WideFloat> Scene::hit(const Ray<WideFloat> &rays, const RayHits &found, WideBool active,
                          const Footprint<WideFloat> &footprints, const HitNeeds &needs) const {
    const int first = std::countr_zero(bits(active));
    const RayHits hits{found.distance,
                       found.b1,
                       found.b2,
                       select(active, found.shape, WideInt(found.shape[first])),
                       select(active, found.primitive, WideInt(found.primitive[first])),
                       select(active, found.instance, WideInt(found.instance[first]))};
    Hit<WideFloat> result;
    result.distance = hits.distance;
    result.shape = hits.shape;
    result.primitive = hits.primitive;
    result.instance = hits.instance;
    const auto slots = load_rows([&](int k) {
        return reinterpret_cast<const float *>(&parts_.slots[static_cast<std::size_t>(hits.shape[k])]);
    });
    result.material = as_int(slots.x), result.emitter = as_int(slots.y);
    result.interior = as_int(slots.z), result.exterior = as_int(slots.w);

    unsigned in_meshes = 0; // one bit a lane
    for (int k = 0; k < lanes; ++k)
        in_meshes |= static_cast<unsigned>(mesh_of(hits.shape[k]).triangles != nullptr) << k;
    const WideBool triangles = mask_of(in_meshes) && hits.instance == -1;
    if (any(triangles)) fill_triangles(hits, triangles, needs, result);
    if (const WideBool others = active && !triangles; any(others))
        for_each_lane(others,
                      [&](int k) { set_lane(result, k, hit(lane_of(rays, k), hits[k], needs), needs); });
    result.footprint.move(footprints, rays.direction, hits.distance, result.normal);
    return result;
}

// Sets what depends on triangles in the lanes of `filled`; it is undefined in the others.
void Scene::fill_triangles(const RayHits &hits, WideBool filled, const HitNeeds &needs,
                           Hit<WideFloat> &result) const {
    static constexpr float nothing[4]{};
    const float *positions[3][lanes], *normals[3][lanes], *uvs[3][lanes];
    const unsigned kept = bits(filled); // one bit a lane, as these:
    unsigned with_normals = 0, with_uvs = 0, flipped = 0, lifted = 0;
    for (int k = 0; k < lanes; ++k) {
        const unsigned bit = 1u << k;
        if (!(kept & bit)) {
            for (int corner = 0; corner < 3; ++corner)
                positions[corner][k] = normals[corner][k] = uvs[corner][k] = nothing;
            continue;
        }
        const MeshArrays &mesh = mesh_of(hits.shape[k]);
        const Triangle &t = mesh.triangles[hits.primitive[k]];
        with_normals |= mesh.normals ? bit : 0, with_uvs |= mesh.uvs ? bit : 0;
        flipped |= mesh.flip_normals ? bit : 0;
        if (needs.lift && mesh.normals && materials_->terminator(result.material[k]) == Terminator::hanika)
            lifted |= bit;
        for (std::size_t corner = 0; corner < 3; ++corner) {
            positions[corner][k] = &mesh.positions[t[corner]].x;
            normals[corner][k] = mesh.normals ? &mesh.normals[t[corner]].x : nothing;
            uvs[corner][k] = mesh.uvs ? &mesh.uvs[t[corner]].x : nothing;
        }
    }
    const auto vector = [](const float *const(&rows)[lanes]) {
        const auto q = load_rows([&](int k) { return rows[k]; });
        return Vec3<WideFloat>{q.x, q.y, q.z};
    };
    const auto pair = [&](const float *const(&rows)[lanes]) {
        const Vec3<WideFloat> v = vector(rows);
        return Vec2<WideFloat>{v.x, v.y};
    };
    const TriangleCorners<WideFloat> corners{vector(positions[0]), vector(positions[1]),
                                             vector(positions[2])};
    TriangleNormals<WideFloat> triangle_normals;
    if (with_normals)
        triangle_normals = {mask_of(with_normals), vector(normals[0]), vector(normals[1]),
                            vector(normals[2])};
    TriangleUvs<WideFloat> triangle_uvs;
    if (with_uvs && (needs.uvs || needs.tangents))
        triangle_uvs = {mask_of(with_uvs), pair(uvs[0]), pair(uvs[1]), pair(uvs[2])};
    HitNeeds own = needs;
    own.lift = lifted != 0;
    fill_triangle(corners, triangle_normals, triangle_uvs, mask_of(flipped), hits.b1, hits.b2, own, result);
    if (result.lift) {
        result.lift->front = select(mask_of(lifted), result.lift->front, Vec3<WideFloat>(0));
        result.lift->back = select(mask_of(lifted), result.lift->back, Vec3<WideFloat>(0));
        if (!any(result.lift->is_raised())) result.lift.reset();
    }
}

namespace {

Vec3f rounded(const std::array<double, 3> &p) {
    return {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
}

} // namespace

std::array<double, 3> Scene::world_position(const Vec3f &p) const {
    const auto &[x, y, z] = parts_.origin;
    return {p.x + x, p.y + y, p.z + z};
}

Vec3f Scene::in_world(const Vec3f &p) const { return rounded(world_position(p)); }

Vec3f Scene::from_world(const std::array<double, 3> &p) const {
    const auto &[x, y, z] = parts_.origin;
    return rounded({p[0] - x, p[1] - y, p[2] - z});
}

std::optional<Scene::PlainMaterial> Scene::plain_material(std::int32_t id) const {
    if (id < 0) return PlainMaterial{};
    const Material &material = (*materials_)[id];
    const MaterialId &front = material.front, &back = material.back;
    const auto is_plain = [&](const MaterialId &side) {
        return side.adapter < 0 && (side.bsdf < 0 || !traits_of(side.bsdf).null_transmission);
    };
    if (!is_plain(front) || !is_plain(back)) return std::nullopt;
    return PlainMaterial{front.bsdf, back.bsdf};
}

Scene::Side Scene::side(const Hit<float> &hit, const Vec3f &wo) const {
    const bool softened = materials_->terminator(hit.material) == Terminator::chiang;
    const MappedNormal<float> front{hit.shading_normal, hit.dp_du, false, false, softened};
    if (hit.material < 0) return {{}, false, front};
    const Material &material = (*materials_)[hit.material];
    if (dot(hit.normal, wo) >= 0 || material.back == MaterialId{}) return {material.front, false, front};
    return {material.back, true, {-hit.shading_normal, hit.dp_du, true, false, softened}};
}

Scene::Choice Scene::choose(const Hit<float> &hit, const Vec3f &wo, float u) const {
    const Side seen = side(hit, wo);
    Choice choice{seen.root.bsdf, seen.turned, seen.normal};
    if (seen.root.adapter >= 0)
        materials_->choose(seen.root, unfiltered_reader(hit), hit, wo, u, seen.normal, true,
                           [&](std::int32_t bsdf, const MappedNormal<float> &normal, bool) {
                               choice.bsdf = bsdf;
                               choice.normal = normal;
                           });
    return choice;
}

AnySurface Scene::surface(const Hit<float> &hit, const Vec3f &wo, float u) const {
    return surface(choose(hit, wo, u), hit, wo);
}

AnySurface Scene::surface(const Choice &choice, const Hit<float> &hit, const Vec3f &wo) const {
    const auto &[id, turned, normal] = choice;
    if (id < 0) return {};
    const BsdfTraits &traits = traits_of(id);
    if (sees_black(traits, hit, wo, turned)) return {};
    const Lobe lobe = prepare(parts_.bsdfs[static_cast<std::size_t>(id)], bsdf_reader(traits, hit, wo));
    return surface_of(traits, lobe, hit, wo, normal, least_roughness());
}

std::optional<Spectrum> Scene::diffuse_colour(const Hit<float> &hit, const Vec3f &wo, float u) const {
    const std::int32_t id = choose(hit, wo, u).bsdf;
    const auto *colour = id < 0 ? nullptr : traits_of(id).diffuse_colour;
    return colour ? std::optional(filtered_reader(hit, wo)(*colour)) : std::nullopt;
}

Spectrum Scene::albedo(const Hit<float> &hit, const Vec3f &wo, float u) const {
    if (const auto colour = diffuse_colour(hit, wo, u)) return *colour;
    const AnySurface seen = surface(hit, wo, u);
    return seen.black ? Spectrum(0) : eval(seen.lobe, seen.wo, {0, 0, 1}).f_cos * pi;
}

Vec3f Scene::mapped_normal(const Hit<float> &hit, const Vec3f &wo, float u) const {
    const Choice choice = choose(hit, wo, u);
    return choice.turned ? -choice.normal.n : choice.normal.n;
}

NullTransmission<float> Scene::null_transmission(const Hit<float> &hit, const Vec3f &wo) const {
    const auto [root, turned, normal] = side(hit, wo);
    return materials_->null_transmission(root, unfiltered_reader(hit), hit, wo, normal);
}

const Bitmap *Scene::first_bitmap(const Hit<float> &hit) const {
    const Bitmap *result = nullptr;
    if (hit.material < 0) return result;
    const std::int32_t front = materials_->first_bsdf((*materials_)[hit.material].front);
    if (front < 0) return result;
    const auto look_at = [&](const auto &value) {
        if constexpr (requires { value.id; })
            if (!result && value.id >= 0)
                result = std::get_if<Bitmap>(&parts_.textures[static_cast<std::size_t>(value.id)]);
    };
    match(parts_.bsdfs[static_cast<std::size_t>(front)], [&](const auto &bsdf) {
        for_each_field<std::decay_t<decltype(bsdf)>>([&](const auto &field) { look_at(bsdf.*field.member); });
    });
    return result;
}

std::size_t Scene::light_group_count() const {
    std::int32_t last = 0;
    for (const std::int32_t group : parts_.light_groups) last = std::max(last, group);
    return static_cast<std::size_t>(last) + 1;
}

std::size_t Scene::bytes() const {
    std::size_t sum = parts_.instances.size() * sizeof(Instance);
    for (const Shape &shape : parts_.shapes)
        if (const auto *mesh = std::get_if<TriangleMesh>(&shape)) sum += mesh->mesh->bytes();
        else if (const auto *curves = std::get_if<Curves>(&shape)) sum += curves->curves->bytes();
        else if (const auto *sdf = std::get_if<SdfGrid>(&shape)) sum += sdf->bytes();
    for (const TextureModel &texture : parts_.textures)
        if (const auto *bitmap = std::get_if<Bitmap>(&texture)) sum += bitmap->pixels.bytes();
    for (const Light &light : parts_.lights)
        if (const auto *map = std::get_if<EnvironmentMap>(&light)) sum += map->image->bytes();
    return sum + parts_.media->bytes();
}

} // namespace lajolla
