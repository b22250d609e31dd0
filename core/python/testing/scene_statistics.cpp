// Vectorised calls into filters, shapes and hits of a scene, for the statistical tests.

#include "python/testing/bindings.h"

#include <optional>
#include <vector>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "python/values.h"
#include "transport/path.h"

namespace lajolla {

namespace {

using namespace nb::literals;
nb::object emitter_powers(const RenderableScene &self, float radius) {
    const Scene &scene = *self.scene;
    return tabulate<1>(scene.parts().lights.size(), [&](std::size_t i) {
        return match(scene.parts().lights[i], [&](const auto &light) {
            return light.power(scene.parts().textures, {Vec3f(0), radius});
        });
    });
}

nb::tuple filter_sample_many(const nb::dict &description, const Rows<2> &u) {
    const FilterSampler filter(variant_from<PixelFilter>(description, "rfilter"));
    Table<float, 2> offset(u.shape(0));
    Table<float, 1> weight(u.shape(0));
    for (std::size_t i = 0; i < u.shape(0); ++i) {
        const auto s = filter.sample(pair(u, i));
        offset.set(i, s.offset);
        weight.set(i, s.weight);
    }
    return nb::make_tuple(std::move(offset).to_numpy(), std::move(weight).to_numpy());
}

nb::dict shape_sample_many(const RenderableScene &self, std::uint32_t index, const Rows<3> &u) {
    const SceneParts &parts = self.scene->parts();
    if (index >= parts.shapes.size()) throw nb::index_error("there is no such shape");
    if (parts.slots[index].emitter < 0)
        throw std::invalid_argument("only shapes that are lights can be sampled");
    const std::size_t n = u.shape(0);
    Table<float, 3> position(n), normal(n);
    Table<float, 2> barycentric(n);
    Table<float, 1> position_error(n), area_pdf(n);
    Table<std::uint32_t, 1> primitive(n);
    for (std::size_t i = 0; i < n; ++i) {
        const SurfaceSample s = match(parts.shapes[index], [&](const auto &shape) {
            return shape.sample(u(i, 0), {u(i, 1), u(i, 2)});
        });
        position.set(i, self.scene->in_world(s.position));
        normal.set(i, s.normal);
        barycentric.set(i, Vec2f{s.b1, s.b2});
        position_error.set(i, s.position_error);
        area_pdf.set(i, s.area_pdf);
        primitive.set(i, s.primitive);
    }
    nb::dict result;
    result["position"] = std::move(position).to_numpy();
    result["normal"] = std::move(normal).to_numpy();
    result["barycentric"] = std::move(barycentric).to_numpy();
    result["position_error"] = std::move(position_error).to_numpy();
    result["area_pdf"] = std::move(area_pdf).to_numpy();
    result["primitive"] = std::move(primitive).to_numpy();
    return result;
}

// The closest hits of rays; none where a ray meets nothing.
std::vector<std::optional<Hit<float>>> closest_hits(const Scene &scene, const Rows<3> &origins,
                                                    const Rows<3> &directions) {
    require_one_or(origins.shape(0), directions.shape(0), "origins");
    std::vector<std::optional<Hit<float>>> hits(directions.shape(0));
    for (std::size_t i = 0; i < hits.size(); ++i) {
        const Ray<float> ray{scene.from_world(triple(origins, i)), triple(directions, i)};
        if (const auto found = scene.accel().closest(ray)) hits[i] = scene.hit(ray, *found);
    }
    return hits;
}

// A column of hits; zero where there is none.
template <class T, std::size_t N>
nb::object column(const std::vector<std::optional<Hit<float>>> &hits, auto &&f) {
    Table<T, N> table(hits.size());
    for (std::size_t i = 0; i < hits.size(); ++i) table.set(i, f(hits[i] ? *hits[i] : Hit<float>{}));
    return std::move(table).to_numpy();
}

nb::dict hit_many(const RenderableScene &self, const Rows<3> &origins, const Rows<3> &directions) {
    const auto hits = closest_hits(*self.scene, origins, directions);
    Table<bool, 1> valid(hits.size());
    for (std::size_t i = 0; i < hits.size(); ++i) valid.set(i, hits[i].has_value());
    nb::dict result;
    result["valid"] = std::move(valid).to_numpy();
    result["position"] =
        column<float, 3>(hits, [&](const Hit<float> &h) { return self.scene->in_world(h.position); });
    result["normal"] = column<float, 3>(hits, [](const Hit<float> &h) { return h.normal; });
    result["shading_normal"] = column<float, 3>(hits, [](const Hit<float> &h) { return h.shading_normal; });
    result["dp_du"] = column<float, 3>(hits, [](const Hit<float> &h) { return h.dp_du; });
    result["dp_dv"] = column<float, 3>(hits, [](const Hit<float> &h) { return h.dp_dv; });
    result["barycentric"] = column<float, 2>(hits, [](const Hit<float> &h) { return h.barycentric; });
    result["uv"] = column<float, 2>(hits, [](const Hit<float> &h) { return h.uv; });
    result["distance"] = column<float, 1>(hits, [](const Hit<float> &h) { return h.distance; });
    result["position_error"] = column<float, 1>(hits, [](const Hit<float> &h) { return h.position_error; });
    result["mean_curvature"] = column<float, 1>(hits, [](const Hit<float> &h) { return h.mean_curvature(); });
    result["shape"] = column<std::int32_t, 1>(hits, [](const Hit<float> &h) { return h.shape; });
    result["primitive"] = column<std::int32_t, 1>(hits, [](const Hit<float> &h) { return h.primitive; });
    result["material"] = column<std::int32_t, 1>(hits, [](const Hit<float> &h) { return h.material; });
    result["emitter"] = column<std::int32_t, 1>(hits, [](const Hit<float> &h) { return h.emitter; });
    return result;
}

// Follows a camera ray over `bounces` surfaces, each of which scatters it by the same numbers; returns the
// hit after them, or nothing, and sets the direction in which the ray arrives, and a number of its
// primitives.
std::optional<Hit<float>> hit_after(const Scene &scene, const Vec2f &film, const Vec2f &lens, float u_lobe,
                                    int bounces, Vec3f &direction, std::uint32_t &route) {
    CameraRay<float> camera = scene.camera_ray(film, lens);
    camera.film = film, camera.lens = lens;
    PathState<float> path = Path{}.start(scene, camera);
    for (int bounce = 0;; ++bounce) {
        direction = path.ray.direction;
        const auto found = scene.accel().closest(path.ray);
        if (!found) return std::nullopt;
        route = (route * 31 + found->shape) * 1009 + found->primitive;
        const Hit<float> hit = scene.hit(path.ray, *found, path.footprint, scene.needs());
        if (bounce == bounces) return hit;
        const AnySurface surface = scene.surface(hit, -direction, 0.5f);
        if (surface.black) return std::nullopt;
        const BsdfSample<float> sample = surface.sample(u_lobe, {0.5f, 0.5f});
        if (!sample.valid) return std::nullopt;
        path = Path::scattered(scene, path, hit, surface.departure(hit, sample.wi), sample, surface.delta);
    }
}

nb::dict differentials_after(const RenderableScene &self, const Rows<2> &film, const Rows<2> &lens,
                             float u_lobe, int bounces) {
    const std::size_t n = film.shape(0);
    require_one_or(lens.shape(0), n, "lens");
    Table<bool, 1> valid(n), followed(n);
    Table<std::uint32_t, 1> route(n);
    Table<float, 2> uv(n), uv_dx(n), uv_dy(n);
    Table<float, 3> position(n), position_dx(n), position_dy(n), direction(n), direction_dx(n),
        direction_dy(n);
    for (std::size_t i = 0; i < n; ++i) {
        Vec3f arriving;
        std::uint32_t met = 0;
        const auto hit = hit_after(*self.scene, pair(film, i), pair(lens, lens.shape(0) == 1 ? 0 : i), u_lobe,
                                   bounces, arriving, met);
        const RayDifferentials<float> none{{}, {}, {}, {}, false};
        const auto d = hit ? hit->footprint.differentials.value_or(none) : none;
        route.set(i, met);
        valid.set(i, hit.has_value()), followed.set(i, d.followed);
        const UvEllipse<float> ellipse = hit ? uv_ellipse(*hit, d) : UvEllipse<float>{};
        uv.set(i, hit ? hit->uv : Vec2f{}), uv_dx.set(i, ellipse.first * 2.0f),
            uv_dy.set(i, ellipse.second * 2.0f);
        position.set(i, hit ? hit->position : Vec3f(0));
        position_dx.set(i, d.origin_dx), position_dy.set(i, d.origin_dy);
        direction.set(i, arriving), direction_dx.set(i, d.direction_dx), direction_dy.set(i, d.direction_dy);
    }
    nb::dict result;
    result["valid"] = std::move(valid).to_numpy();
    result["followed"] = std::move(followed).to_numpy();
    result["route"] = std::move(route).to_numpy();
    result["uv"] = std::move(uv).to_numpy();
    result["uv_dx"] = std::move(uv_dx).to_numpy();
    result["uv_dy"] = std::move(uv_dy).to_numpy();
    result["position"] = std::move(position).to_numpy();
    result["position_dx"] = std::move(position_dx).to_numpy();
    result["position_dy"] = std::move(position_dy).to_numpy();
    result["direction"] = std::move(direction).to_numpy();
    result["direction_dx"] = std::move(direction_dx).to_numpy();
    result["direction_dy"] = std::move(direction_dy).to_numpy();
    return result;
}

nb::object leave_many(const RenderableScene &self, const Rows<3> &origins, const Rows<3> &directions,
                      const Rows<3> &onward) {
    require_one_or(onward.shape(0), directions.shape(0), "onward");
    const auto hits = closest_hits(*self.scene, origins, directions);
    return tabulate<3>(hits.size(), [&](std::size_t i) {
        return hits[i] ? self.scene->in_world(leave(*hits[i], triple(onward, i)))
                       : Vec3f(std::numeric_limits<float>::quiet_NaN());
    });
}

nb::object majorants_along(const Media &self, std::int32_t medium, const Column &ray) {
    if (medium < 0 || static_cast<std::size_t>(medium) >= self.size())
        throw nb::index_error("there is no such medium");
    if (ray.shape(0) != 8) throw std::invalid_argument("a ray is eight numbers");
    const auto *varying = std::get_if<Heterogeneous>(&self[medium]);
    if (!varying) throw std::invalid_argument("only heterogeneous media have majorants");
    std::vector<Vec3f> pieces;
    varying->majorants.traverse({{ray(0), ray(1), ray(2)}, {ray(3), ray(4), ray(5)}, ray(6), ray(7)},
                                [&](float t0, float t1, float bound) {
                                    pieces.emplace_back(t0, t1, bound);
                                    return true;
                                });
    return tabulate<3>(pieces.size(), [&](std::size_t i) { return pieces[i]; });
}

} // namespace

void bind_scene_statistics(nb::module_ &m) {
    m.def("emitter_powers", &emitter_powers, "scene"_a, "radius"_a,
          "Power (N,) of every light, were the scene's bounding sphere of this radius.");
    m.def("filter_sample_many", &filter_sample_many, "description"_a, "u"_a,
          "Samples a pixel filter with u (N, 2): offsets (N, 2) in pixels and weights (N,).");
    m.def(
        "shape_sample_many", &shape_sample_many, "scene"_a, "shape"_a, "u"_a,
        "Samples points of a shape that is a light with u (N, 3): a dict of arrays position, normal (N, 3), "
        "barycentric (N, 2), position_error, area_pdf and primitive (N,).");
    m.def("majorants_along", &majorants_along, "media"_a, "medium"_a, "ray"_a,
          "The pieces t0, t1, majorant (M, 3) along a ray: origin, direction, near and far.");
    m.def("hit_many", &hit_many, "scene"_a, "origins"_a, "directions"_a,
          "The closest hits of rays (1 or N, 3), (N, 3): a dict of arrays of the fields of a hit, and valid "
          "(N,).");
    m.def("differentials_after", &differentials_after, "scene"_a, "film"_a, "lens"_a, "u_lobe"_a, "bounces"_a,
          "Where camera rays through film positions (N, 2) and points of the lens (1 or N, 2) hit a surface "
          "after so many bounces: a dict of arrays valid, followed (N,), route (N,), alike for rays that met "
          "the same triangles, uv (N, 2), position, direction (N, 3); and of the changes of these from one "
          "pixel to the next, uv_dx, uv_dy, and so on.");
    m.def(
        "leave_many", &leave_many, "scene"_a, "origins"_a, "directions"_a, "onward"_a,
        "Where rays (N, 3) that leave the closest hits in directions `onward` (1 or N, 3) start; NaN without "
        "a hit.");
}

} // namespace lajolla
