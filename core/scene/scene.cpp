#include "scene/scene.h"

namespace lajolla {

namespace {

Bounds bounds_of(const Shape &shape) {
    return match(shape, [](const auto &s) { return s.bounds(); });
}

BoundingSphere sphere_around(const SceneParts &parts) {
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
    if (box.empty()) return {};
    return {(box.low + box.high) * 0.5f, std::max(length(box.high - box.low) / 2, 1e-6f)};
}

} // namespace

Scene::Scene(SceneParts parts) : parts_(std::move(parts)), filter_(parts_.filter) {
    for (std::size_t i = 0; i < parts_.shapes.size(); ++i) {
        const std::int32_t emitter = parts_.slots[i].emitter;
        if (emitter < 0) continue;
        auto *light = std::get_if<AreaLight>(&parts_.lights[static_cast<std::size_t>(emitter)]);
        if (!light) throw std::invalid_argument("only area emitters can be attached to shapes");
        if (light->shape) throw std::invalid_argument("two shapes share one area emitter");
        light->shape = &parts_.shapes[i];
        match(parts_.shapes[i], [](auto &shape) { shape.prepare_sampling(); });
    }
    for (const Group &group : parts_.groups)
        for (const std::uint32_t id : group)
            if (parts_.slots[id].emitter >= 0)
                throw std::invalid_argument("a shape in a group cannot be a light");
    for (Light &light : parts_.lights)
        if (auto *area = std::get_if<AreaLight>(&light)) {
            if (!area->shape) throw std::invalid_argument("an area emitter needs a shape");
            area->prepare_sampling(parts_.textures);
        }

    for (const Bsdf &bsdf : parts_.bsdfs)
        bsdf_traits_.push_back({is_transmissive(bsdf), is_isotropic(bsdf), is_delta(bsdf),
                                std::holds_alternative<Diffuse>(bsdf), lets_pass(bsdf)});
    for (const TextureModel &texture : parts_.textures)
        if (const auto *bitmap = std::get_if<Bitmap>(&texture))
            reads_footprints_ |= bitmap->reads_footprints();
    materials_ = Materials(parts_.materials, parts_.adapters, parts_.bsdfs);
    for (const Adapter &adapter : parts_.adapters) has_blends_ |= std::holds_alternative<Blend>(adapter);

    bounding_sphere_ = sphere_around(parts_);
    const CameraFit fit{parts_.film.aspect(), static_cast<float>(parts_.film.width), bounding_sphere_};
    match(parts_.camera, [&](auto &camera) {
        camera.build(fit);
        to_camera_ = inverse(camera.to_world).value_or(Transform{});
    });
    picker_ = LightPicker(parts_.lights, parts_.textures, bounding_sphere_);
    accel_.emplace(parts_.shapes, parts_.groups, parts_.instances);
}

Hit Scene::hit(const Ray &ray, const RayHit &found, const RayCone &cone) const {
    Hit hit;
    hit.distance = found.distance;
    hit.footprint = cone.at(found.distance);
    hit.shape = found.shape;
    hit.primitive = found.primitive;
    const ShapeSlot &slot = parts_.slots[found.shape];
    hit.material = slot.material;
    hit.emitter = slot.emitter;
    hit.interior = slot.interior;
    hit.exterior = slot.exterior;
    if (found.instance != RayHit::no_instance) [[unlikely]]
        fill_in_instance(ray, found, hit);
    else match(parts_.shapes[found.shape], [&](const auto &shape) { shape.fill(ray, found, hit); });
    return hit;
}

void Scene::fill_in_instance(const Ray &ray, const RayHit &found, Hit &hit) const {
    const Instance &instance = parts_.instances[found.instance];
    const Ray inside = instance.in_group(ray);
    match(parts_.shapes[found.shape], [&](const auto &shape) { shape.fill(inside, found, hit); });
    instance.place(hit);
}

Scene::Side Scene::side(const Hit &hit, const Vec3f &wo) const {
    const MappedNormal front{hit.shading_normal, hit.dp_du, false};
    if (hit.material < 0) return {{}, false, front};
    const Material &material = materials_[hit.material];
    if (dot(hit.normal, wo) >= 0 || material.back == MaterialId{}) return {material.front, false, front};
    return {material.back, true, {-hit.shading_normal, hit.dp_du, true}};
}

Scene::Choice Scene::choose(const Hit &hit, const Vec3f &wo, float u) const {
    const Side seen = side(hit, wo);
    Choice choice{seen.root.bsdf, seen.turned, seen.normal};
    if (seen.root.adapter >= 0)
        choice.bsdf = materials_.choose(seen.root, sharp_reader(hit), hit, wo, u, choice.normal);
    return choice;
}

Surface Scene::surface(const Hit &hit, const Vec3f &wo, float u) const {
    return surface(choose(hit, wo, u), hit, wo);
}

Surface Scene::surface(const Choice &choice, const Hit &hit, const Vec3f &wo) const {
    const auto &[id, turned, normal] = choice;
    if (id < 0) return {};
    const SeenNormals seen = seen_from(wo, hit.normal, normal);
    const bool behind = seen.behind;
    const BsdfTraits traits = bsdf_traits_[static_cast<std::size_t>(id)];
    if (behind && !turned && !traits.transmissive) return {};

    // Towards the viewer, until it is known whether the lobe tells the sides apart.
    Vec3f n = seen.shading;
    const bool bent = !(n == seen.geometric);
    if (bent)
        n = traits.lambertian ? seen_from_above(n, seen.geometric, wo)
                              : with_mirror_image_above(n, seen.geometric, wo);
    if (behind && traits.transmissive) n = -n;
    const Frame frame = traits.isotropic ? frame_around(n) : frame_along(n, normal.tangent);
    Bend bend{bent};
    if (bent) {
        bend.normal = frame.to_local(hit.normal);
        if (normal.shadowed) {
            bend.smooth = frame.to_local(hit.shading_normal);
            bend.bump = tangent_squared(bend.smooth.z);
        }
    }
    // Scenes write alpha = 0.0001 for a mirror. Such a lobe is narrower than any light that has an area, so
    // that samples of lights would only cost time; lights without area need them still.
    const float sharpest = picker_.has_delta_lights() ? 0 : 5e-4f;
    const Bsdf &bsdf = parts_.bsdfs[static_cast<std::size_t>(id)];
    const TextureReader read = traits.lets_pass ? sharp_reader(hit) : filtered_reader(hit, wo);
    return {bsdf, read, traits.delta, traits.lets_pass, sharpest, frame, wo, bend};
}

Spectrum Scene::albedo(const Hit &hit, const Vec3f &wo, float u) const {
    const std::int32_t id = choose(hit, wo, u).bsdf;
    if (id < 0) return Spectrum(0);
    const auto colour = diffuse_colour(parts_.bsdfs[static_cast<std::size_t>(id)], filtered_reader(hit, wo));
    if (colour) return *colour;
    const Surface seen = surface(hit, wo, u);
    return seen.black ? Spectrum(0) : eval(seen.lobe, seen.wo, {0, 0, 1}).f_cos * pi;
}

Vec3f Scene::mapped_normal(const Hit &hit, const Vec3f &wo, float u) const {
    const Choice choice = choose(hit, wo, u);
    return choice.turned ? -choice.normal.n : choice.normal.n;
}

Passage Scene::passage(const Hit &hit, const Vec3f &wo) const {
    const auto [root, turned, normal] = side(hit, wo);
    return materials_.passage(root, sharp_reader(hit), hit, wo, normal);
}

const Bitmap *Scene::first_bitmap(const Hit &hit) const {
    const Bitmap *result = nullptr;
    if (hit.material < 0) return result;
    const std::int32_t front = materials_.first_bsdf(materials_[hit.material].front);
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
    return sum + parts_.media.bytes();
}

} // namespace lajolla
