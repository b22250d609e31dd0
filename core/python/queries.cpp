// Ray queries in bulk.

#include "python/bindings.h"

#include <algorithm>
#include <limits>
#include <memory>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "transport/tiles.h"

namespace lajolla {

namespace {

using namespace nb::literals;

constexpr std::size_t block = 64 * lanes; // rays of a task

// Rays of a table: as many origins, directions and ends as there are rays, or one for all.
struct RayRows {
    const Scene &scene;
    const Rows<3> &origins, &directions;
    const Column &ends;
    std::size_t count;

    RayRows(const Scene &s, const Rows<3> &from, const Rows<3> &along, const Column &far)
        : scene(s), origins(from), directions(along), ends(far),
          count(std::max({from.shape(0), along.shape(0), far.shape(0)})) {
        require_one_or(from.shape(0), count, "origins");
        require_one_or(along.shape(0), count, "directions");
        require_one_or(far.shape(0), count, "max_distance");
    }

    // Some of them, from `first` on; lanes beyond the last repeat it.
    Ray<WideFloat> packet(std::size_t first) const {
        Ray<WideFloat> rays;
        for (int k = 0; k < lanes; ++k) {
            const std::size_t i = std::min(first + static_cast<std::size_t>(k), count - 1);
            set_lane(rays.origin, k, scene.from_world(triple(origins, i)));
            set_lane(rays.direction, k, triple(directions, i));
            rays.far.v[k] = ends(ends.shape(0) == 1 ? 0 : i);
        }
        return rays;
    }
    WideBool active(std::size_t first) const {
        const std::size_t left = count - first;
        return mask_of(left < lanes ? (1u << left) - 1 : (1u << lanes) - 1);
    }

    // f(first ray, rays, lanes that are rays) for packets of all, on many threads.
    template <class F>
    void for_each_packet(int threads, F &&f) const {
        for_each_index((count + block - 1) / block, threads, [&](std::size_t task) {
            const std::size_t end = std::min((task + 1) * block, count);
            for (std::size_t i = task * block; i < end; i += lanes) f(i, packet(i), active(i));
        });
    }
};

// Where rays meet surfaces, as tables; distance is infinite, ids are -1 and all else is zero without a hit.
struct Intersections {
    Table<float, 1> distance;
    Table<float, 3> position, normal, geometric_normal;
    Table<float, 2> uv;
    Table<std::int32_t, 1> shape, primitive, instance;

    explicit Intersections(std::size_t n)
        : distance(n), position(n), normal(n), geometric_normal(n), uv(n), shape(n), primitive(n),
          instance(n) {}

    void set(std::size_t i, const Scene &scene, const RayHits &found, const Hit<WideFloat> &hit, int k) {
        distance.set(i, found.distance[k]);
        shape.set(i, found.shape[k]);
        primitive.set(i, found.primitive[k]);
        instance.set(i, found.instance[k]);
        position.set(i, scene.in_world(lane_of(hit.position, k)));
        normal.set(i, lane_of(hit.shading_normal, k));
        geometric_normal.set(i, lane_of(hit.normal, k));
        uv.set(i, hit.uv.x[k], hit.uv.y[k]);
    }
    void set_miss(std::size_t i) {
        distance.set(i, infinity);
        shape.set(i, -1), primitive.set(i, -1), instance.set(i, -1);
        position.set(i, Vec3f(0)), normal.set(i, Vec3f(0)), geometric_normal.set(i, Vec3f(0));
        uv.set(i, 0.0f, 0.0f);
    }

    nb::dict to_numpy() && {
        nb::dict result;
        result["distance"] = std::move(distance).to_numpy();
        result["position"] = std::move(position).to_numpy();
        result["normal"] = std::move(normal).to_numpy();
        result["geometric_normal"] = std::move(geometric_normal).to_numpy();
        result["uv"] = std::move(uv).to_numpy();
        result["shape"] = std::move(shape).to_numpy();
        result["primitive"] = std::move(primitive).to_numpy();
        result["instance"] = std::move(instance).to_numpy();
        return result;
    }
};

nb::dict intersect(const RenderableScene &self, const Rows<3> &origins, const Rows<3> &directions,
                   const Column &max_distance, int threads) {
    const Scene &scene = *self.scene;
    const RayRows rows(scene, origins, directions, max_distance);
    Intersections result(rows.count);
    {
        const nb::gil_scoped_release release;
        const HitNeeds needs{true, false, false};
        rows.for_each_packet(threads, [&](std::size_t first, const Ray<WideFloat> &rays, WideBool active) {
            const RayHits found = scene.accel().closest(rays, active);
            const WideBool hit = active && found.shape != -1;
            Hit<WideFloat> hits;
            if (any(hit)) hits = scene.hit(rays, found, hit, {}, needs);
            for_each_lane(active, [&](int k) {
                const std::size_t i = first + static_cast<std::size_t>(k);
                if (hit.v[k]) result.set(i, scene, found, hits, k);
                else result.set_miss(i);
            });
        });
    }
    return std::move(result).to_numpy();
}

nb::object occluded(const RenderableScene &self, const Rows<3> &origins, const Rows<3> &directions,
                    const Column &max_distance, int threads) {
    const RayRows rows(*self.scene, origins, directions, max_distance);
    Table<bool, 1> result(rows.count);
    {
        const nb::gil_scoped_release release;
        rows.for_each_packet(threads, [&](std::size_t first, const Ray<WideFloat> &rays, WideBool active) {
            const WideBool found = self.scene->accel().occluded(rays, active);
            for_each_lane(active,
                          [&](int k) { result.set(first + static_cast<std::size_t>(k), found.v[k] != 0); });
        });
    }
    return std::move(result).to_numpy();
}

} // namespace

void bind_queries(nb::module_ &m) {
    m.def("intersect", &intersect, "scene"_a, "origins"_a, "directions"_a, "max_distance"_a, "threads"_a = 0,
          "The closest hits of rays: origins (1 or N, 3), directions (1 or N, 3) and max_distance (1 or N,) "
          "of float32. A dict of arrays distance (N,), in lengths of the direction and infinite without a "
          "hit; position, normal, geometric_normal (N, 3); uv (N, 2); and the positions shape, primitive and "
          "instance (N,) in the description's lists, -1 for none.");
    m.def("occluded", &occluded, "scene"_a, "origins"_a, "directions"_a, "max_distance"_a, "threads"_a = 0,
          "Whether rays meet anything: bool (N,); see intersect().");
}

} // namespace lajolla
