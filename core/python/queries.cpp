// Ray queries in bulk.

#include "python/bindings.h"

#include <algorithm>
#include <array>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "transport/tiles.h"

namespace lajolla {

namespace {

using namespace nb::literals;

constexpr std::size_t block = 64 * lanes; // rays of a task

// Rays of a table: as many origins, directions and ends as there are rays, or one for all. Origins are
// float32 or, as positions far from the world's origin must be, float64.
template <class Real>
struct RayRows {
    const Scene &scene;
    const Rows<3, Real> &origins;
    const Rows<3> &directions;
    const Column &ends;
    std::size_t count;

    RayRows(const Scene &s, const Rows<3, Real> &from, const Rows<3> &along, const Column &far)
        : scene(s), origins(from), directions(along), ends(far),
          count(std::max({from.shape(0), along.shape(0), far.shape(0)})) {
        require_one_or(from.shape(0), count, "origins");
        require_one_or(along.shape(0), count, "directions");
        require_one_or(far.shape(0), count, "max_distance");
    }

    // Some of them, from `first` on; lanes beyond the last repeat it.
    Ray<WideFloat> packet(std::size_t first) const {
        std::array<std::array<float, lanes>, 7> columns;
        for (std::size_t k = 0; k < lanes; ++k) {
            const std::size_t i = std::min(first + k, count - 1);
            const Vec3f origin = scene.from_world(lajolla::position(origins, i));
            const Vec3f direction = triple(directions, i);
            columns[0][k] = origin.x, columns[1][k] = origin.y, columns[2][k] = origin.z;
            columns[3][k] = direction.x, columns[4][k] = direction.y, columns[5][k] = direction.z;
            columns[6][k] = ends(ends.shape(0) == 1 ? 0 : i);
        }
        const auto column = [&](std::size_t c) { return load(columns[c].data()); };
        return {{column(0), column(1), column(2)}, {column(3), column(4), column(5)}, 0, column(6)};
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
    Table<double, 3> position;
    Table<float, 3> normal, geometric_normal;
    Table<float, 2> uv;
    Table<std::int32_t, 1> shape, primitive, instance;

    explicit Intersections(std::size_t n)
        : distance(n), position(n), normal(n), geometric_normal(n), uv(n), shape(n), primitive(n),
          instance(n) {}

    // Those of a packet, the first of which is the `first` ray.
    void set(std::size_t first, const Scene &scene, const RayHits &found, const Hit<WideFloat> &hit,
             WideBool active) {
        std::array<std::array<float, lanes>, 12> columns;
        std::array<std::array<std::int32_t, lanes>, 3> ids;
        std::size_t next = 0;
        const auto put = [&](const WideFloat &v) { store(columns[next++].data(), v); };
        const auto put_all = [&](const Vec3<WideFloat> &v) { put(v.x), put(v.y), put(v.z); };
        put(found.distance), put_all(hit.position), put_all(hit.shading_normal), put_all(hit.normal);
        put(hit.uv.x), put(hit.uv.y);
        store(ids[0].data(), found.shape), store(ids[1].data(), found.primitive);
        store(ids[2].data(), found.instance);
        for_each_lane(active, [&](int lane) {
            const auto k = static_cast<std::size_t>(lane), i = first + k;
            if (ids[0][k] < 0) return set_miss(i);
            const auto at = [&](std::size_t c) {
                return Vec3f{columns[c][k], columns[c + 1][k], columns[c + 2][k]};
            };
            distance.set(i, columns[0][k]);
            position.set(i, scene.world_position(at(1)));
            normal.set(i, at(4));
            geometric_normal.set(i, at(7));
            uv.set(i, columns[10][k], columns[11][k]);
            shape.set(i, ids[0][k]), primitive.set(i, ids[1][k]), instance.set(i, ids[2][k]);
        });
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

template <class Real>
nb::dict intersect(const RenderableScene &self, const Rows<3, Real> &origins, const Rows<3> &directions,
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
            result.set(first, scene, found, hits, active);
        });
    }
    return std::move(result).to_numpy();
}

template <class Real>
nb::object occluded(const RenderableScene &self, const Rows<3, Real> &origins, const Rows<3> &directions,
                    const Column &max_distance, int threads) {
    const RayRows rows(*self.scene, origins, directions, max_distance);
    Table<bool, 1> result(rows.count);
    {
        const nb::gil_scoped_release release;
        rows.for_each_packet(threads, [&](std::size_t first, const Ray<WideFloat> &rays, WideBool active) {
            const Accel &accel = self.scene->accel();
            const WideBool found = accel.occluded(rays, active) && accel.traceable(rays);
            for_each_lane(active,
                          [&](int k) { result.set(first + static_cast<std::size_t>(k), found.v[k] != 0); });
        });
    }
    return std::move(result).to_numpy();
}

template <class Real>
void bind_queries_from(nb::module_ &m) {
    m.def(
        "intersect", &intersect<Real>, "scene"_a, "origins"_a.noconvert(), "directions"_a, "max_distance"_a,
        "threads"_a = 0,
        "The closest hits of rays: origins (1 or N, 3) of float32 or float64, directions (1 or N, 3) and "
        "max_distance (1 or N,) of float32. A dict of arrays distance (N,), in lengths of the direction and "
        "infinite without a hit; position (N, 3) of float64; normal, geometric_normal (N, 3); uv (N, 2); "
        "and the positions shape, primitive and instance (N,) in the description's lists, -1 for none. "
        "Rays that are not finite or extremely large, and those that end before they begin, have no hits.");
    m.def("occluded", &occluded<Real>, "scene"_a, "origins"_a.noconvert(), "directions"_a, "max_distance"_a,
          "threads"_a = 0, "Whether rays meet anything: bool (N,); see intersect().");
}

} // namespace

void bind_queries(nb::module_ &m) {
    bind_queries_from<float>(m);
    bind_queries_from<double>(m);
}

} // namespace lajolla
