#include "transport/wavefront.h"

namespace lajolla {

namespace {

const float *row(const void *first, int i) { return static_cast<const float *>(first) + 4 * i; }
float *row(void *first, int i) { return static_cast<float *>(first) + 4 * i; }

Vec3<WideFloat> vector_of(const Quad<WideFloat> &q) { return {q.x, q.y, q.z}; }
Quad<WideFloat> quad(const Vec3<WideFloat> &v, WideFloat w) { return {v.x, v.y, v.z, w}; }

// Whether a model's lobes are computed in lanes.
bool is_wide_model(const Bsdf &bsdf) {
    return match(bsdf, [](const auto &model) { return IsWide<std::decay_t<decltype(model)>>; });
}

} // namespace

Wavefront::Wavefront(const Scene &scene, const Path &integrator)
    : scene_(scene), integrator_(integrator), light_group_count_(scene.light_group_count()),
      group_sizes_(scene.parts().materials.size() + 3), samplers_(most_samples), paths_(capacity + lanes),
      next_(capacity + lanes), hits_(capacity + lanes), shapes_(capacity + lanes),
      instances_(capacity + lanes),
      shadow_rays_((scene.needs().lift ? 2 : 1) * Materials::most_lit_leaves * capacity + lanes),
      order_(capacity + lanes), group_of_path_(capacity + lanes) {
    if (integrator.follows_differentials(scene)) {
        differentials_.resize(capacity + lanes);
        next_differentials_.resize(capacity + lanes);
    }
    const auto is_wide = [&](MaterialId root) {
        bool wide = true;
        scene.materials().for_each_bsdf(root, [&](std::int32_t bsdf) {
            wide &= bsdf < 0 || is_wide_model(scene.parts().bsdfs[static_cast<std::size_t>(bsdf)]);
        });
        return wide;
    };
    std::vector<bool> wide;
    for (const Material &material : scene.parts().materials)
        wide.push_back(is_wide(material.front) && is_wide(material.back));
    const auto transmits = [&](std::int32_t material) {
        if (material < 0) return false;
        const Material &m = scene.materials()[material];
        return scene.materials().has_null_transmission(m.front) ||
               scene.materials().has_null_transmission(m.back);
    };
    for (const ShapeSlot &slot : scene.parts().slots) transmits_.push_back(transmits(slot.material));
    for (const ShapeSlot &slot : scene.parts().slots)
        group_of_shape_.push_back(
            slot.material < 0 || wide[static_cast<std::size_t>(slot.material)] ? slot.material : one_by_one);
}

void Wavefront::render(std::span<const SampleId> ids, SequenceKind sequence, std::uint32_t seed,
                       Tracer &tracer, std::span<Spectrum> radiance, std::span<float> weights,
                       std::span<Spectrum> groups) {
    radiance_ = radiance;
    group_light_ = groups;
    std::ranges::fill(group_light_, Spectrum(0));
    for (std::size_t i = 0; i < ids.size(); ++i) {
        samplers_[i] = Sampler(sequence, seed, ids[i].x, ids[i].y, ids[i].index);
        radiance[i] = Spectrum(0);
    }
    next_count_ = 0;
    for (std::size_t started = 0; started < ids.size() || next_count_ > 0;) {
        // Few paths would leave many lanes empty, so that others begin before the last one has ended.
        if (next_count_ <= capacity / 2) {
            const std::size_t count = std::min(capacity - next_count_, ids.size() - started);
            start(ids, started, count, weights);
            started += count;
        }
        std::swap(paths_, next_);
        std::swap(differentials_, next_differentials_);
        count_ = std::exchange(next_count_, 0);
        if (integrator_.max_depth == 0) continue;
        trace(tracer);
        sort();
        shadow_count_ = 0;
        for (const Group &group : groups_) scatter(group, tracer);
        trace_shadow_rays(tracer);
    }
}

// --- lanes in and out

// Calls f(packet) for all paths of a group; lanes that are off repeat the last one.
template <class F>
void Wavefront::for_each_packet(std::span<const std::int32_t> paths, F &&f) const {
    Packet packet;
    for (std::size_t i = 0; i < paths.size(); i += lanes) {
        for (std::size_t k = 0; k < lanes; ++k) {
            packet.paths[k] = paths[std::min(i + k, paths.size() - 1)];
            packet.samples[k] = sample_of(packet.paths[k]);
        }
        packet.active = first_lanes(static_cast<int>(std::min<std::size_t>(paths.size() - i, lanes)));
        f(packet);
    }
}

// The sign of the density marks that light sampling was impossible.
PathState<WideFloat> Wavefront::load(const Packet &packet) const {
    const StoredPath *stored[lanes];
    for (int k = 0; k < lanes; ++k) stored[k] = &paths_[static_cast<std::size_t>(packet.paths[k])];
    const auto rows = [&](int i) { return load_rows([&](int k) { return row(stored[k], i); }); };
    const auto origin = rows(0), direction = rows(1), throughput = rows(2), from = rows(3), range = rows(4),
               counts = rows(5);
    PathState<WideFloat> path;
    path.ray = {vector_of(origin), vector_of(direction), range.x, range.y};
    path.footprint.cone = {from.w, range.z};
    path.from = vector_of(from);
    path.pdf = abs(origin.w);
    path.delta = as_int(origin.w) < 0;
    path.throughput = Rgb<WideFloat>(vector_of(throughput));
    path.eta = direction.w;
    path.u_event = throughput.w;
    path.depth = as_int(counts.x);
    path.block = as_int(counts.y);
    path.null_transmissions = as_int(counts.z);
    if (!differentials_.empty()) path.footprint.differentials = load_differentials(packet, range.w != 0.0f);
    return path;
}

// Of the lanes that follow them.
std::optional<RayDifferentials<WideFloat>> Wavefront::load_differentials(const Packet &packet,
                                                                         WideBool followed) const {
    if (!any(followed)) return std::nullopt;
    const StoredDifferentials *stored[lanes];
    for (int k = 0; k < lanes; ++k) stored[k] = &differentials_[static_cast<std::size_t>(packet.paths[k])];
    const auto rows = [&](int i) { return load_rows([&](int k) { return row(stored[k], i); }); };
    const auto a = rows(0), b = rows(1), c = rows(2);
    return RayDifferentials<WideFloat>{
        {a.x, a.y, a.z}, {a.w, b.x, b.y}, {b.z, b.w, c.x}, {c.y, c.z, c.w}, followed};
}

std::int32_t Wavefront::sample_of(std::int32_t path) const {
    return as_int(paths_[static_cast<std::size_t>(path)].rows[5][3]);
}

RayHits Wavefront::load_hits(const Packet &packet) const {
    const auto q =
        load_rows([&](int k) { return &hits_[static_cast<std::size_t>(packet.paths[k])].distance; });
    const WideInt index = lajolla::load(packet.paths);
    return {q.x, q.y, q.z, gather(shapes_.data(), index), as_int(q.w), gather(instances_.data(), index)};
}

PathState<float> Wavefront::one(std::size_t path) const {
    const auto &r = paths_[path].rows;
    const auto vector = [](const float *v) { return Vec3f{v[0], v[1], v[2]}; };
    PathState<float> result;
    result.ray = {vector(r[0]), vector(r[1]), r[4][0], r[4][1]};
    result.footprint.cone = {r[3][3], r[4][2]};
    if (r[4][3] != 0) {
        const float *const d = differentials_[path].rows[0];
        result.footprint.differentials = {vector(d), vector(d + 3), vector(d + 6), vector(d + 9), true};
    }
    result.from = vector(r[3]);
    result.pdf = std::abs(r[0][3]);
    result.delta = std::signbit(r[0][3]);
    result.throughput = Spectrum(vector(r[2]));
    result.eta = r[1][3];
    result.u_event = r[2][3];
    result.depth = as_int(r[5][0]);
    result.block = as_int(r[5][1]);
    result.null_transmissions = as_int(r[5][2]);
    return result;
}

void Wavefront::append(const PathState<float> &p, std::int32_t sample) {
    const Vec3f &o = p.ray.origin, &d = p.ray.direction;
    const auto &changes = p.footprint.differentials;
    const bool followed = changes && changes->followed;
    if (followed) {
        const auto &[ox, oy, dx, dy, unused] = *changes;
        next_differentials_[next_count_] = {
            {{ox.x, ox.y, ox.z, oy.x}, {oy.y, oy.z, dx.x, dx.y}, {dx.z, dy.x, dy.y, dy.z}}};
    }
    next_[next_count_++] = {
        {{o.x, o.y, o.z, std::copysign(p.pdf, p.delta ? -1.0f : 1.0f)},
         {d.x, d.y, d.z, p.eta},
         {p.throughput.x, p.throughput.y, p.throughput.z, p.u_event},
         {p.from.x, p.from.y, p.from.z, p.footprint.cone.radius},
         {p.ray.near, p.ray.far, p.footprint.cone.spread, followed ? 1.0f : 0.0f},
         {as_float(p.depth), as_float(p.block), as_float(p.null_transmissions), as_float(sample)}}};
}

void Wavefront::append(const PathState<WideFloat> &path, const Packet &packet, WideBool active) {
    StoredPath unused;
    StoredPath *to[lanes];
    const unsigned kept = bits(active);
    const auto &differentials = path.footprint.differentials;
    if (differentials) store_differentials(*differentials, next_count_, kept);
    StoredPath *end = next_.data() + next_count_;
    for (int k = 0; k < lanes; ++k) to[k] = kept >> k & 1 ? end++ : &unused;
    next_count_ = static_cast<std::size_t>(end - next_.data());
    const auto store = [&](int i, const Quad<WideFloat> &q) {
        store_rows(q, [&](int k) { return row(to[k], i); });
    };
    const WideFloat pdf = copysign(path.pdf, select(path.delta, WideFloat(-1), WideFloat(1)));
    store(0, quad(path.ray.origin, pdf));
    store(1, quad(path.ray.direction, path.eta));
    store(2, quad(Vec3<WideFloat>(path.throughput), path.u_event));
    store(3, quad(path.from, path.footprint.cone.radius));
    const WideBool followed = differentials ? differentials->followed : WideBool(false);
    store(4, {path.ray.near, path.ray.far, path.footprint.cone.spread,
              select(followed, WideFloat(1), WideFloat(0))});
    store(5, {as_float(path.depth), as_float(path.block), as_float(path.null_transmissions),
              as_float(lajolla::load(packet.samples))});
}

void Wavefront::store_differentials(const RayDifferentials<WideFloat> &d, std::size_t first, unsigned kept) {
    StoredDifferentials unused;
    StoredDifferentials *to[lanes];
    for (int k = 0; k < lanes; ++k) to[k] = kept >> k & 1 ? &next_differentials_[first++] : &unused;
    const auto store = [&](int i, const Quad<WideFloat> &q) {
        store_rows(q, [&](int k) { return row(to[k], i); });
    };
    store(0, {d.origin_dx.x, d.origin_dx.y, d.origin_dx.z, d.origin_dy.x});
    store(1, {d.origin_dy.y, d.origin_dy.z, d.direction_dx.x, d.direction_dx.y});
    store(2, {d.direction_dx.z, d.direction_dy.x, d.direction_dy.y, d.direction_dy.z});
}

void Wavefront::append(const Ray<WideFloat> &ray, const Rgb<WideFloat> &value, WideInt light,
                       const Packet &packet, WideBool active) {
    StoredShadowRay unused;
    StoredShadowRay *to[lanes];
    const unsigned kept = bits(active);
    StoredShadowRay *end = shadow_rays_.data() + shadow_count_;
    for (int k = 0; k < lanes; ++k) to[k] = kept >> k & 1 ? end++ : &unused;
    shadow_count_ = static_cast<std::size_t>(end - shadow_rays_.data());
    store_rows(quad(ray.origin, ray.far), [&](int k) { return row(to[k], 0); });
    store_rows(quad(ray.direction, as_float(lajolla::load(packet.samples))),
               [&](int k) { return row(to[k], 1); });
    store_rows(quad(Vec3<WideFloat>(value), as_float(light)), [&](int k) { return row(to[k], 2); });
}

template <class F>
void Wavefront::add(const Rgb<WideFloat> &value, const Packet &packet, WideBool active,
                    const Vec3<WideFloat> &direction, F &&light) {
    for_each_lane(active, [&](int k) {
        radiance_[static_cast<std::size_t>(packet.samples[k])] +=
            Spectrum(value.x[k], value.y[k], value.z[k]);
    });
    if (group_light_.empty()) [[likely]]
        return;
    const WideInt lights = light();
    for_each_lane(active, [&](int k) {
        light_groups(packet.samples[k]).add(lights[k], lane_of(direction, k), lane_of(value, k));
    });
}

LightGroups Wavefront::light_groups(std::int32_t sample) const {
    if (group_light_.empty()) return {};
    return {scene_,
            group_light_.subspan(static_cast<std::size_t>(sample) * light_group_count_, light_group_count_)};
}

// --- the steps

void Wavefront::start(std::span<const SampleId> ids, std::size_t first, std::size_t count,
                      std::span<float> weights) {
    for (std::size_t i = first; i < first + count; i += lanes) {
        const std::size_t last = first + count - 1;
        const auto sampler = [&](int k) -> const Sampler & {
            return samplers_[std::min(i + static_cast<std::size_t>(k), last)];
        };
        alignas(64) float x[lanes], y[lanes], weight[lanes];
        Packet packet;
        for (std::size_t k = 0; k < lanes; ++k) {
            const SampleId &id = ids[std::min(i + k, last)];
            x[k] = static_cast<float>(id.x), y[k] = static_cast<float>(id.y);
            packet.samples[k] = static_cast<std::int32_t>(i + k);
        }
        const auto film = sample_film(scene_, Sampler::cameras(sampler), lajolla::load(x), lajolla::load(y));
        const std::size_t active = std::min(last + 1 - i, static_cast<std::size_t>(lanes));
        append(integrator_.start(scene_, film.camera), packet, first_lanes(static_cast<int>(active)));
        store(weight, film.weight);
        std::copy_n(weight, active, weights.data() + i);
    }
}

void Wavefront::trace(Tracer &tracer) {
    for (std::size_t i = 0; i < count_; i += lanes) {
        const auto rows = [&](int r) {
            return load_rows([&](int k) { return row(&paths_[i + static_cast<std::size_t>(k)], r); });
        };
        const auto origin = rows(0), direction = rows(1), range = rows(4);
        const WideBool active = first_lanes(static_cast<int>(std::min<std::size_t>(count_ - i, lanes)));
        const RayHits hits =
            tracer.closest({vector_of(origin), vector_of(direction), range.x, range.y}, active);
        store_rows({hits.distance, hits.b1, hits.b2, as_float(hits.primitive)},
                   [&](int k) { return &hits_[i + static_cast<std::size_t>(k)].distance; });
        store(&shapes_[i], hits.shape);
        store(&instances_[i], hits.instance);
    }
}

// Whether a path is a camera ray that has met a hole, a shadow catcher or an invisible shape, or environments
// of which some are invisible.
bool Wavefront::needs_care(std::size_t path) const {
    if (as_int(paths_[path].rows[5][0]) != 1) return false;
    if (shapes_[path] < 0) return scene_.lights().hides_environments();
    return scene_.camera_role(shapes_[path], instances_[path], integrator_.hide_emitters) !=
           CameraRole::object;
}

// A counting sort; groups come in the order in which paths first meet them.
void Wavefront::sort() {
    const bool careful =
        scene_.has_camera_roles() || integrator_.hide_emitters || scene_.lights().hides_environments();
    const auto group_of = [&](std::size_t path) {
        if (careful && needs_care(path)) return one_by_one;
        return shapes_[path] < 0 ? missed : group_of_shape_[static_cast<std::size_t>(shapes_[path])];
    };
    const auto size_of = [&](std::int32_t group) -> std::uint32_t & {
        return group_sizes_[static_cast<std::size_t>(group - one_by_one)];
    };
    groups_.clear();
    for (std::size_t i = 0; i < count_; ++i) {
        const std::int32_t group = group_of_path_[i] = group_of(i);
        if (size_of(group)++ == 0) groups_.push_back({group, 0, 0});
    }
    std::uint32_t first = 0;
    for (Group &group : groups_) {
        group.first = first;
        first += group.count =
            std::exchange(size_of(group.material), first); // from now on where the next one goes
    }
    for (std::size_t i = 0; i < count_; ++i)
        order_[size_of(group_of_path_[i])++] = static_cast<std::int32_t>(i);
    for (const Group &group : groups_) size_of(group.material) = 0;
}

void Wavefront::scatter(const Group &group, Tracer &tracer) {
    const std::span<const std::int32_t> paths = std::span(order_).subspan(group.first, group.count);
    if (group.material == missed) return gather_environment(paths);
    if (group.material == one_by_one) return follow_one_by_one(paths, tracer);
    const auto plain = scene_.plain_material(group.material);
    if (!plain) return scatter_tree(scene_.materials()[group.material], paths, tracer);
    const auto [front, back] = *plain;
    const bool softened = scene_.materials().terminator(group.material) == Terminator::chiang;
    const auto with = [&](std::int32_t bsdf, Sides sides) {
        if (bsdf < 0) {
            if (sides != Sides::back_only) gather_emission(paths);
            return;
        }
        match(scene_.parts().bsdfs[static_cast<std::size_t>(bsdf)], [&](const auto &model) {
            if constexpr (IsWide<std::decay_t<decltype(model)>>)
                scatter(model, scene_.traits_of(bsdf), sides, softened, paths, tracer);
        });
    };
    if (back < 0) return with(front, Sides::front);
    if (back == front) return with(front, Sides::both);
    with(front, Sides::front_only);
    with(back, Sides::back_only);
}

void Wavefront::trace_shadow_rays(Tracer &tracer) {
    for (std::size_t i = 0; i < shadow_count_; i += lanes) {
        const auto rows = [&](int r) {
            return load_rows([&](int k) { return row(&shadow_rays_[i + static_cast<std::size_t>(k)], r); });
        };
        const auto origin = rows(0), direction = rows(1);
        const WideBool active =
            first_lanes(static_cast<int>(std::min<std::size_t>(shadow_count_ - i, lanes)));
        const WideBool occluded =
            tracer.occluded({vector_of(origin), vector_of(direction), 0, origin.w}, active);
        for_each_lane(active && !occluded, [&](int k) {
            const StoredShadowRay &ray = shadow_rays_[i + static_cast<std::size_t>(k)];
            const Spectrum value(ray.value[0], ray.value[1], ray.value[2]);
            radiance_[static_cast<std::size_t>(ray.sample)] += value;
            if (!group_light_.empty()) [[unlikely]]
                light_groups(ray.sample)
                    .add(ray.light, {ray.direction[0], ray.direction[1], ray.direction[2]}, value);
        });
    }
}

// --- groups

void Wavefront::gather_environment(std::span<const std::int32_t> paths) {
    if (!scene_.lights().has_environment()) return;
    for_each_packet(paths, [&](const Packet &packet) {
        const auto path = load(packet);
        const WideBool shown = path.depth > 1 || WideBool(!integrator_.hide_emitters);
        add(path.throughput * integrator_.environment(scene_, path), packet, packet.active && shown,
            path.ray.direction, [&] { return WideInt(scene_.lights().environment_light()); });
    });
}

// What the lanes have no code for is done to one path after the other, as depth first.
void Wavefront::follow_one_by_one(std::span<const std::int32_t> paths, Tracer &tracer) {
    for (const std::int32_t index : paths) {
        const auto i = static_cast<std::size_t>(index);
        const auto sample = static_cast<std::size_t>(sample_of(index));
        Path::Walk<Vacuum> walk{one(i), Vacuum(), radiance_[sample],
                                light_groups(static_cast<std::int32_t>(sample))};
        const Sampler &sampler = samplers_[sample];
        std::optional<RayHit> found;
        if (shapes_[i] >= 0)
            found = {hits_[i].distance,
                     hits_[i].b1,
                     hits_[i].b2,
                     static_cast<std::uint32_t>(shapes_[i]),
                     static_cast<std::uint32_t>(hits_[i].primitive),
                     static_cast<std::uint32_t>(instances_[i])};
        bool goes_on = integrator_.step(scene_, tracer, sampler, found, walk);
        while (goes_on && walk.from_catcher)
            goes_on = integrator_.step(scene_, tracer, sampler, tracer.closest(walk.path.ray), walk);
        radiance_[sample] = walk.radiance;
        if (goes_on) append(walk.path, static_cast<std::int32_t>(sample));
    }
}

void Wavefront::gather_emission(std::span<const std::int32_t> paths) {
    for_each_packet(paths, [&](const Packet &packet) {
        const auto path = load(packet);
        add_emission(path,
                     scene_.hit(path.ray, load_hits(packet), packet.active, path.footprint, scene_.needs()),
                     packet);
    });
}

void Wavefront::add_emission(const PathState<WideFloat> &path, const Hit<WideFloat> &hit,
                             const Packet &packet) {
    const WideBool shines = packet.active && hit.emitter >= 0;
    if (any(shines))
        add(path.throughput * integrator_.emitted(scene_, path, hit), packet, shines, path.ray.direction,
            [&] { return hit.emitter; });
}

BounceSample<WideFloat> Wavefront::numbers(const Packet &packet, const PathState<WideFloat> &path) const {
    return Sampler::bounces(
        [&](int k) -> const Sampler & { return samplers_[static_cast<std::size_t>(packet.samples[k])]; },
        path.block);
}

// Light that the lanes' samples send to their surfaces: along shadow rays, which are traced later; or at
// once, where surfaces may let some of it pass, and then one ray after the other that meets such a surface.
void Wavefront::add_direct_light(const Vertex &vertex, const DirectSample<WideFloat> &light,
                                 const BsdfEval<WideFloat> &bsdf, const Vec3<WideFloat> &origin,
                                 WideFloat share, WideBool lit, Tracer &tracer) {
    const Hit<WideFloat> &hit = vertex.hit;
    const Rgb<WideFloat> throughput = vertex.path.throughput * share;
    const Rgb<WideFloat> value = throughput * integrator_.direct(light, bsdf, WideFloat(1));
    const Ray<WideFloat> ray = shadow_ray(origin, hit.position_error, light);
    const auto lights = [&] { return scene_.lights().picked(vertex.u.light); };
    if (!scene_.has_null_transmission())
        return append(ray, value, group_light_.empty() ? WideInt(0) : lights(), vertex.packet, lit);

    const RayHits blockers = tracer.closest(ray, lit);
    add(value, vertex.packet, lit && blockers.shape < 0, light.wi, lights);
    for_each_lane(lit && blockers.shape >= 0, [&](int k) {
        if (!transmits_[static_cast<std::size_t>(blockers.shape[k])]) return;
        const DirectSample<float> one_light = lane_of(light, k);
        const auto arriving = transmittance(scene_, tracer, lane_of(ray, k), blockers[k],
                                            hit.position_error[k], one_light, Vacuum());
        if (!arriving) return;
        const BsdfEval<float> f{lane_of(bsdf.f_cos, k), bsdf.pdf[k], bsdf.eta[k]};
        const Spectrum one_value = lane_of(throughput, k) *
                                   (integrator_.direct(one_light, f, arriving->path_pdf) * arriving->value());
        radiance_[static_cast<std::size_t>(vertex.packet.samples[k])] += one_value;
        light_groups(vertex.packet.samples[k]).add_picked(vertex.u.light[k], one_light.wi, one_value);
    });
}

template <class LobeType>
void Wavefront::sample_light(const Vertex &vertex, const Surface<WideFloat, LobeType> &surface,
                             WideFloat share, WideBool active, Tracer &tracer) {
    for_each_vertex(vertex.hit, surface, [&](const auto &at) {
        const DirectSample<WideFloat> light =
            scene_.lights().sample_direct(at.position(), vertex.u.light, vertex.u.light_uv);
        const BsdfEval<WideFloat> f = surface.eval(light.wi);
        const WideBool lit =
            active && integrator_.counts(light) && at.gathers(light.wi) && !is_black(f.f_cos);
        if (any(lit)) add_direct_light(vertex, light, f, at.leave(light.wi), share, lit, tracer);
    });
}

template <class Model>
[[gnu::noinline]] void Wavefront::scatter_at(const Vertex &vertex, const Model &model,
                                             const BsdfTraits &traits, const MappedNormal<WideFloat> &normal,
                                             WideBool turned, WideBool active, WideFloat share, Task task,
                                             Tracer &tracer) {
    const auto &[packet, incoming, hit, wo, u] = vertex;
    active = active && !sees_black(traits, hit, wo, turned);
    if (!any(active)) return;
    const auto lobe = prepare_lobe<WideFloat>(model, scene_.bsdf_reader(traits, hit, wo));
    const auto surface = surface_of(traits, lobe, hit, wo, normal, scene_.least_roughness());

    const WideBool lightable = active && !surface.delta;
    if (task != Task::sample_direction && !scene_.lights().empty() && any(lightable))
        sample_light(vertex, surface, share, lightable, tracer);
    if (task == Task::sample_light) return;

    const BsdfSample<WideFloat> sample = surface.sample(u.lobe, u.bsdf_uv);
    WideBool goes_on = active && sample.valid;
    PathState<WideFloat> path =
        Path::scattered(scene_, incoming, hit, surface.departure(hit, sample.wi), sample, surface.delta);
    const WideBool broken = goes_on && !is_finite(path.throughput);
    if (any(broken)) // whoever takes the sample counts it
        for_each_lane(broken, [&](int k) {
            radiance_[static_cast<std::size_t>(packet.samples[k])] = lane_of(path.throughput, k);
        });
    goes_on = goes_on && !broken && integrator_.survives(u, highest_survival, path);
    append(path, packet, goes_on);
}

void Wavefront::scatter_at(const Vertex &vertex, std::int32_t bsdf, const MappedNormal<WideFloat> &normal,
                           WideBool turned, WideBool active, WideFloat share, Task task, Tracer &tracer) {
    if (bsdf < 0) return;
    match(scene_.parts().bsdfs[static_cast<std::size_t>(bsdf)], [&](const auto &model) {
        if constexpr (IsWide<std::decay_t<decltype(model)>>)
            scatter_at(vertex, model, scene_.traits_of(bsdf), normal, turned, active, share, task, tracer);
    });
}

template <class Model>
[[gnu::noinline]] void Wavefront::scatter(const Model &model, const BsdfTraits &traits, Sides sides,
                                          bool softened, std::span<const std::int32_t> paths,
                                          Tracer &tracer) {
    for_each_packet(paths, [&](const Packet &packet) {
        const PathState<WideFloat> path = load(packet);
        Hit<WideFloat> hit =
            scene_.hit(path.ray, load_hits(packet), packet.active, path.footprint, scene_.needs());
        if (sides != Sides::back_only) add_emission(path, hit, packet);

        const Vec3<WideFloat> wo = -path.ray.direction;
        const WideBool turned = !(dot(hit.normal, wo) >= 0.0f) && WideBool(sides != Sides::front);
        WideBool active = packet.active && path.depth != integrator_.max_depth;
        if (sides == Sides::front_only) active = active && !turned;
        if (sides == Sides::back_only) active = active && turned;
        if (!any(active)) return;
        lower_lift(tracer, active, hit);
        const Vec3<WideFloat> normal = select(turned, -hit.shading_normal, hit.shading_normal);
        const MappedNormal<WideFloat> unmapped{normal, hit.dp_du, turned, false, softened};
        scatter_at({packet, path, hit, wo, numbers(packet, path)}, model, traits, unmapped, turned, active, 1,
                   Task::both, tracer);
    });
}

void Wavefront::scatter_tree(const Material &material, std::span<const std::int32_t> paths, Tracer &tracer) {
    const Materials &materials = scene_.materials();
    for_each_packet(paths, [&](const Packet &packet) {
        const PathState<WideFloat> path = load(packet);
        Hit<WideFloat> hit =
            scene_.hit(path.ray, load_hits(packet), packet.active, path.footprint, scene_.needs());
        add_emission(path, hit, packet);

        Vertex vertex{packet, path, hit, -path.ray.direction, numbers(packet, path)};
        const Vec3<WideFloat> &wo = vertex.wo;
        const auto read = scene_.unfiltered_reader(hit);
        const WideBool behind = !(dot(hit.normal, wo) >= 0.0f) && WideBool(!(material.back == MaterialId{}));
        const auto scatter_side = [&](MaterialId root, WideBool turned, WideBool active) {
            if (!any(active)) return;
            const MappedNormal<WideFloat> normal{select(turned, -hit.shading_normal, hit.shading_normal),
                                                 hit.dp_du, turned, false,
                                                 material.terminator == Terminator::chiang};
            WideFloat u = path.u_event;
            if (materials.has_null_transmission(root)) {
                const auto through = materials.null_transmission(root, read, hit, wo, normal);
                const WideBool passes_through = active && passes(through.probability, u);
                PathState<WideFloat> onward = path;
                onward.u_event = u;
                Path::pass_through(hit, through, onward);
                append(onward, packet, passes_through && onward.null_transmissions <= max_null_transmissions);
                active = active && !passes_through;
            }
            active = active && path.depth != integrator_.max_depth;
            if (!any(active)) return;
            lower_lift(tracer, active, hit);
            const bool each_leaf = materials.is_small_blend(root);
            if (each_leaf)
                materials.for_each_leaf(root, read, hit, wo, normal, WideFloat(1),
                                        [&](std::int32_t bsdf, const auto &leaf_normal, WideFloat share) {
                                            scatter_at(vertex, bsdf, leaf_normal, turned,
                                                       active && share != 0.0f, share, Task::sample_light,
                                                       tracer);
                                        });
            materials.choose(root, read, hit, wo, u, normal, active,
                             [&](std::int32_t bsdf, const auto &leaf_normal, WideBool chosen) {
                                 scatter_at(vertex, bsdf, leaf_normal, turned, chosen, 1,
                                            each_leaf ? Task::sample_direction : Task::both, tracer);
                             });
        };
        if (material.back == material.front) return scatter_side(material.front, behind, packet.active);
        scatter_side(material.front, false, packet.active && !behind);
        scatter_side(material.back, true, packet.active && behind);
    });
}

} // namespace lajolla
