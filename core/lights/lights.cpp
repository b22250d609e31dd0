#include "lights/lights.h"

#include <algorithm>
#include <cstring>

namespace lajolla {

namespace {

// --- lanes of several lights -------------------------------------------------------------------------------

// Numbers 4 row to 4 row + 3 of one record per lane. Inlined, so that unused rows are not loaded.
template <class Float, class Record>
[[gnu::always_inline]] inline Quad<Float> load_row(const Record *records, IntOf<Float> index,
                                                   std::size_t row) {
    const auto at = [&](std::int32_t i) { return reinterpret_cast<const float *>(records + i) + 4 * row; };
    if constexpr (is_wide<Float>) return load_rows([&](int lane) { return at(index[lane]); });
    else return {at(index)[0], at(index)[1], at(index)[2], at(index)[3]};
}

template <class Float>
[[gnu::always_inline]] inline LightRecord<Float> load_light(const std::vector<LightRecord<float>> &lights,
                                                            IntOf<Float> index) {
    static_assert(sizeof(LightRecord<float>) == 64);
    const LightRecord<float> *from = lights.data();
    const auto [r, g, b, kind] = load_row<Float>(from, index, 0);
    const auto [x, y, z, radius] = load_row<Float>(from, index, 1);
    const auto [position_error, side, probability, area_pdf] = load_row<Float>(from, index, 2);
    const auto [count, first_primitive, first_sum, unused] = load_row<Float>(from, index, 3);
    return {{r, g, b},
            as_int(kind),
            {x, y, z},
            radius,
            position_error,
            side,
            probability,
            area_pdf,
            count,
            as_int(first_primitive),
            as_int(first_sum)};
}

template <class Float>
[[gnu::always_inline]] inline LightPrimitive<Float>
load_primitive(const std::vector<LightPrimitive<float>> &primitives, IntOf<Float> index) {
    static_assert(sizeof(LightPrimitive<float>) == 64);
    const LightPrimitive<float> *from = primitives.data();
    const auto corner = load_row<Float>(from, index, 0), edge1 = load_row<Float>(from, index, 1),
               edge2 = load_row<Float>(from, index, 2), normal = load_row<Float>(from, index, 3);
    return {{corner.x, corner.y, corner.z}, corner.w, {edge1.x, edge1.y, edge1.z},   0,
            {edge2.x, edge2.y, edge2.z},    0,        {normal.x, normal.y, normal.z}};
}

// --- lane by lane ------------------------------------------------------------------------------------------

// For one light the only lane is 0.
template <class F>
void for_each_lane(bool m, F &&f) {
    if (m) f(0);
}
template <class Number>
auto lane(const Number &x, int k) {
    if constexpr (std::is_arithmetic_v<Number>) return x;
    else return x[k];
}
template <class Float>
Vec2f lane(const Vec2<Float> &v, int k) {
    return {lane(v.x, k), lane(v.y, k)};
}
template <class Float>
Vec3f lane(const Vec3<Float> &v, int k) {
    return {lane(v.x, k), lane(v.y, k), lane(v.z, k)};
}
const Hit<float> &lane(const Hit<float> &hit, int) { return hit; }
Hit<float> lane(const Hit<WideFloat> &hits, int k) { return lane_of(hits, k); }

void put(float &x, int, float value) { x = value; }
void put(bool &x, int, bool value) { x = value; }
void put(WideFloat &x, int k, float value) { x.v[k] = value; }
void put(WideBool &x, int k, bool value) { x.v[k] = value ? -1 : 0; }
template <class Tag, class Float>
void put(Triple<Tag, Float> &x, int k, const Triple<Tag, float> &value) {
    put(x.x, k, value.x), put(x.y, k, value.y), put(x.z, k, value.z);
}
template <class Float>
void put(DirectSample<Float> &x, int k, const DirectSample<float> &value) {
    put(x.wi, k, value.wi), put(x.distance, k, value.distance);
    put(x.target, k, value.target), put(x.radiance, k, value.radiance);
    put(x.pdf, k, value.pdf), put(x.delta, k, value.delta);
}

// --- picking -----------------------------------------------------------------------------------------------

// Selection of lights: with probability 1/2 by power, otherwise uniformly, because power does not depend on
// distance: nearby dim lights must be sampled too. The power of lights at infinity is that entering the whole
// scene, of which the camera may see little, so it is limited to the power of all others.
std::vector<float> pick_weights(std::span<const Light> lights, std::span<const float> powers) {
    const auto is_distant = [](const auto &light) {
        using T = std::decay_t<decltype(light)>;
        return IsEnvironment<T> || std::is_same_v<T, DirectionalLight>;
    };
    double distant = 0, local = 0, shining = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
        (match(lights[i], is_distant) ? distant : local) += powers[i];
        shining += powers[i] > 0;
    }
    const double factor = local > 0 ? std::min(local / distant, 1.0) : 1;
    const double even = shining > 0 ? (local + factor * distant) / shining : 0;
    std::vector<float> weights;
    for (std::size_t i = 0; i < lights.size(); ++i) {
        const double power = powers[i] * (match(lights[i], is_distant) ? factor : 1);
        weights.push_back(power > 0 ? static_cast<float>(power + even) : 0.0f);
    }
    return weights;
}

} // namespace

LightPicker::LightPicker(std::span<const Light> lights, std::span<const TextureModel> textures,
                         const BoundingSphere &scene)
    : lights_(lights), textures_(textures) {
    std::vector<float> powers;
    for (std::uint32_t i = 0; i < lights.size(); ++i)
        match(lights[i], [&](const auto &light) {
            powers.push_back(light.power(textures, scene));
            has_delta_lights_ |= IsDeltaLight<std::decay_t<decltype(light)>>;
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) {
                environments_.push_back(static_cast<std::int32_t>(i));
                if (light.visible_to_camera) shown_environments_.push_back(static_cast<std::int32_t>(i));
            }
        });
    // A light whose power overflows must not prevent sampling of the others.
    float strongest = 0;
    for (const float power : powers)
        if (std::isfinite(power)) strongest = std::max(strongest, power);
    for (float &power : powers)
        if (!std::isfinite(power)) power = strongest > 0 ? strongest : 1;
    picks_ = Distribution(pick_weights(lights, powers));

    areas_.append(std::array{1.0f});
    for (std::uint32_t i = 0; i < lights.size(); ++i) {
        LightRecord<float> &record = records_.emplace_back();
        record.kind = static_cast<std::int32_t>(LightKind::other);
        record.probability = picks_.probability(static_cast<std::int32_t>(i));
        match(lights[i], [&](const auto &light) {
            using T = std::decay_t<decltype(light)>;
            if constexpr (std::is_same_v<T, AreaLight>) add_record(light, record);
            else if constexpr (IsEnvironment<T>) record.kind = static_cast<std::int32_t>(LightKind::around);
        });
    }
}

void LightPicker::add_record(const AreaLight &light, LightRecord<float> &record) {
    const auto set_kind = [&](LightKind kind) { record.kind = static_cast<std::int32_t>(kind); };
    const float area = light.area();
    record.area_pdf = area > 0 ? record.probability / area : 0;
    record.radiance = light.radiance.constant;
    if (!light.radiance.is_constant()) {
        set_kind(LightKind::textured);
    } else if (const auto *sphere = std::get_if<Sphere>(light.shape)) {
        set_kind(LightKind::sphere);
        record.center = sphere->center;
        record.radius = sphere->radius;
        record.position_error = sphere->at({0, 0, 1}).position_error;
        record.side = sphere->flip_normals ? -1 : 1;
    } else if (const auto *rectangle = std::get_if<Rectangle>(light.shape)) {
        set_kind(LightKind::parallelogram);
        const SurfaceSample corner = rectangle->sample(0, {0, 0});
        record.first_primitive = static_cast<std::int32_t>(primitives_.size());
        primitives_.push_back({corner.position, corner.position_error, rectangle->to_world.axis(0) * 2, 0,
                               rectangle->to_world.axis(1) * 2, 0, corner.normal});
    } else if (const auto *mesh = std::get_if<TriangleMesh>(light.shape)) {
        set_kind(LightKind::triangles);
        record.first_primitive = static_cast<std::int32_t>(primitives_.size());
        for (const auto &t : mesh->light_triangles)
            primitives_.push_back({t.corner, t.position_error, t.edge1, 0, t.edge2, 0, t.normal});
        record.first_sum = static_cast<std::int32_t>(areas_.cdf.size());
        record.primitive_count = static_cast<float>(mesh->areas.size());
        areas_.append(mesh->areas.sums());
    }
}

// --- sampling ----------------------------------------------------------------------------------------------

// A triangle of the light by area, and a point of it uniformly: all points of the light are equally likely.
template <class Float>
DirectSample<Float> LightPicker::sample_primitive(const LightRecord<Float> &light, const Vec3<Float> &p,
                                                  Float u_primitive, const Vec2<Float> &u) const {
    const auto is_mesh = light.is(LightKind::triangles);
    IntOf<Float> index = light.first_primitive;
    if (any(is_mesh)) index += areas_.sample(light.first_sum, light.primitive_count, u_primitive).index;
    const auto primitive = load_primitive<Float>(primitives_, index);
    // The unit square is folded into barycentric coordinates of a triangle, or stretched over a
    // parallelogram.
    const Vec2<Float> b = select(is_mesh, sample_triangle(u), u);
    const Vec3<Float> position = primitive.corner + primitive.edge1 * b.x + primitive.edge2 * b.y;
    return sample_towards(p, position, primitive.normal, primitive.position_error, light.area_pdf);
}

namespace {

template <class Float>
DirectSample<Float> sample_sphere_light(const LightRecord<Float> &light, const Vec3<Float> &p,
                                        const Vec2<Float> &u) {
    const auto cone = cone_towards(light.center, light.radius, p);
    const Vec3<Float> outward = sample_seen_side(cone, light.radius, u);
    DirectSample<Float> sample = sample_towards(p, light.center + outward * light.radius,
                                                outward * light.side, light.position_error, light.area_pdf);
    sample.pdf =
        select(cone.exists && sample.pdf > 0.0f, light.probability * cone_pdf(cone.height), sample.pdf);
    return sample;
}

} // namespace

template <class Float>
DirectSample<Float> LightPicker::sample_direct(const Vec3<Float> &p, Float u_pick,
                                               const Vec2<Float> &u) const {
    // A light, by pick_weights.
    const auto pick = picks_.sample(u_pick);
    const auto light = load_light<Float>(records_, pick.index);
    // A light with low probability leaves few of the 24 bits of u_pick to select a triangle; low bits of u
    // are added.
    const Float low_bits = u.x * 4096 - floor(u.x * 4096);
    const Float u_primitive = min(pick.rest + low_bits * (0x1p-24f / pick.probability), Float(one_minus_ulp));

    DirectSample<Float> sample;
    if (const auto flat = light.is(LightKind::triangles) || light.is(LightKind::parallelogram); any(flat))
        sample = sample_primitive(light, p, u_primitive, u);
    if (const auto round = light.is(LightKind::sphere); any(round))
        sample = select(round, sample_sphere_light(light, p, u), sample);
    sample.radiance = light.radiance;

    for (const std::int32_t index : environments_) {
        const auto picked = pick.index == index;
        if (any(picked))
            match(lights_[static_cast<std::size_t>(index)], [&](const auto &environment) {
                if constexpr (IsEnvironment<std::decay_t<decltype(environment)>>) {
                    auto direct = environment.sample_direct(p, u_primitive, u, textures_);
                    direct.pdf *= light.probability;
                    sample = select(picked, direct, sample);
                }
            });
    }

    const auto alone = light.is(LightKind::textured) || light.is(LightKind::other);
    for_each_lane(alone, [&](int k) {
        auto direct = match(lights_[static_cast<std::size_t>(lane(pick.index, k))], [&](const auto &one) {
            return one.sample_direct(lane(p, k), lane(u_primitive, k), lane(u, k), textures_);
        });
        const float probability = lane(light.probability, k);
        if (direct.delta) direct.radiance *= 1 / probability;
        else direct.pdf *= probability;
        put(sample, k, direct);
    });

    if (environments_.size() > 1) {
        // Environment lights are sampled as one light, by the mixture of their densities.
        const auto around = light.is(LightKind::around) && sample.pdf > 0.0f;
        if (any(around)) {
            sample.radiance = select(around, environment(sample.wi), sample.radiance);
            sample.pdf = select(around, pdf_environment(sample.wi), sample.pdf);
        }
    }
    return sample;
}

template <class Float>
Float LightPicker::pdf_hit(const Vec3<Float> &p, const Hit<Float> &hit, const Vec3<Float> &wi) const {
    const auto shines = hit.emitter >= 0;
    if (empty() || !any(shines)) return 0;
    const auto light = load_light<Float>(records_, select(shines, hit.emitter, IntOf<Float>(0)));
    Float pdf = solid_angle_pdf(p, hit.position, hit.normal, wi, light.area_pdf);
    if (const auto round = light.is(LightKind::sphere); any(round)) {
        const auto cone = cone_towards(light.center, light.radius, p);
        pdf = select(round && cone.exists, light.probability * cone_pdf(cone.height), pdf);
    }
    for_each_lane(shines && light.is(LightKind::textured), [&](int k) {
        const auto &textured = std::get<AreaLight>(lights_[static_cast<std::size_t>(lane(hit.emitter, k))]);
        const float density = textured.pdf_hit(lane(p, k), lane(hit, k), lane(wi, k));
        put(pdf, k, lane(light.probability, k) * density);
    });
    return select(shines, pdf, Float(0));
}

template <class Float>
Float LightPicker::pdf_environment(const Vec3<Float> &wi) const {
    Float sum = 0;
    if (empty()) return sum;
    for (const std::int32_t index : environments_)
        match(lights_[static_cast<std::size_t>(index)], [&](const auto &light) {
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>)
                sum += picks_.probability(index) * light.pdf_direction(wi);
        });
    return sum;
}

template <class Float>
Rgb<Float> LightPicker::emitted(const Hit<Float> &hit, const Vec3<Float> &wo) const {
    const auto shines = hit.emitter >= 0 && dot(hit.normal, wo) > 0.0f;
    if (!any(shines)) return Rgb<Float>(0);
    const auto light = load_light<Float>(records_, select(shines, hit.emitter, IntOf<Float>(0)));
    Rgb<Float> radiance = light.radiance;
    for_each_lane(shines && light.is(LightKind::textured), [&](int k) {
        const auto &textured = std::get<AreaLight>(lights_[static_cast<std::size_t>(lane(hit.emitter, k))]);
        put(radiance, k, textured.emitted(lane(hit, k), lane(wo, k), textures_));
    });
    return select(shines, radiance, Rgb<Float>(0));
}

template <class Float>
Rgb<Float> LightPicker::environment(const Vec3<Float> &direction, bool from_camera) const {
    Rgb<Float> sum(0);
    for (const std::int32_t index : environments(from_camera))
        match(lights_[static_cast<std::size_t>(index)], [&](const auto &light) {
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) sum += light.emitted(direction);
        });
    return sum;
}

Spectrum LightPicker::share_of(std::int32_t environment_light, const Vec3f &direction,
                               const Spectrum &sum) const {
    const Spectrum one = match(lights_[static_cast<std::size_t>(environment_light)], [&](const auto &light) {
        if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) return Spectrum(light.emitted(direction));
        else return Spectrum(0);
    });
    const auto ratio = [](float part, float all) { return all > 0 ? part / all : 0; };
    return {ratio(one.x, sum.x), ratio(one.y, sum.y), ratio(one.z, sum.z)};
}

// --- both number types -------------------------------------------------------------------------------------

template DirectSample<float> LightPicker::sample_direct(const Vec3f &, float, const Vec2f &) const;
template float LightPicker::pdf_hit(const Vec3f &, const Hit<float> &, const Vec3f &) const;
template float LightPicker::pdf_environment(const Vec3f &) const;
template Spectrum LightPicker::emitted(const Hit<float> &, const Vec3f &) const;
template Spectrum LightPicker::environment(const Vec3f &, bool) const;

template DirectSample<WideFloat> LightPicker::sample_direct(const Vec3<WideFloat> &, WideFloat,
                                                            const Vec2<WideFloat> &) const;
template WideFloat LightPicker::pdf_hit(const Vec3<WideFloat> &, const Hit<WideFloat> &,
                                        const Vec3<WideFloat> &) const;
template WideFloat LightPicker::pdf_environment(const Vec3<WideFloat> &) const;
template Rgb<WideFloat> LightPicker::emitted(const Hit<WideFloat> &, const Vec3<WideFloat> &) const;
template Rgb<WideFloat> LightPicker::environment(const Vec3<WideFloat> &, bool) const;

} // namespace lajolla
