// The lights of a scene: sampling them, and what they send to a point.

#include "python/bindings.h"

#include <nanobind/stl/optional.h>

#include <array>
#include <optional>

#include "engine/renderable.h"
#include "python/arrays.h"
#include "transport/visibility.h"

namespace lajolla {

namespace {

using namespace nb::literals;

using Point = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;
using Index = std::optional<std::uint32_t>; // of one light; none: all of them, picked by power

Vec3f point_in(const Scene &scene, const Point &p) {
    return scene.from_world(std::array<double, 3>{p(0), p(1), p(2)});
}

const Light &light_at(const Scene &scene, std::uint32_t index) {
    if (index >= scene.parts().lights.size()) throw nb::index_error("there is no such emitter");
    return scene.parts().lights[index];
}

DirectSample<float> sample_light(const Scene &scene, Index index, Vec3f p, Vec3f u) {
    if (!index) return scene.lights().sample_direct(p, u.x, {u.y, u.z});
    return match(light_at(scene, *index), [&](const auto &light) {
        return light.sample_direct(p, u.x, {u.y, u.z}, scene.parts().textures);
    });
}

// Whether a light's sample is seen from p, as a path's shadow ray finds out.
bool sees(const Scene &scene, Tracer &tracer, Vec3f p, const DirectSample<float> &sample) {
    const auto light = transmittance(scene, tracer, MediumVertex{p, {}, {}}, sample, Vacuum());
    return light && !is_black(light->value());
}

nb::dict sample_emitters(const RenderableScene &self, const Point &point, const Rows<3> &u, Index index) {
    const Scene &scene = *self.scene;
    Tracer tracer(scene.accel());
    const Vec3f p = point_in(scene, point);
    const std::size_t n = u.shape(0);
    Table<float, 3> wi(n), radiance(n);
    Table<float, 1> distance(n), pdf(n);
    Table<bool, 1> delta(n), visible(n);
    for (std::size_t i = 0; i < n; ++i) {
        const DirectSample<float> s = sample_light(scene, index, p, triple(u, i));
        wi.set(i, s.wi);
        radiance.set(i, s.radiance);
        distance.set(i, s.distance);
        pdf.set(i, s.pdf);
        delta.set(i, s.delta);
        visible.set(i, s.pdf > 0 && sees(scene, tracer, p, s));
    }
    nb::dict result;
    result["wi"] = std::move(wi).to_numpy();
    result["distance"] = std::move(distance).to_numpy();
    result["radiance"] = std::move(radiance).to_numpy();
    result["pdf"] = std::move(pdf).to_numpy();
    result["delta"] = std::move(delta).to_numpy();
    result["visible"] = std::move(visible).to_numpy();
    return result;
}

struct Emission {
    Spectrum radiance{0};
    float pdf = 0;
};

// What a path finds that leaves p along wi: radiance, and the density with which lights sample that
// direction. Nothing where a light is seen from behind: it is not sampled there.
Emission emission(const Scene &scene, Index index, Vec3f p, Vec3f wi) {
    const Ray<float> ray{p, wi};
    const auto found = scene.accel().closest(ray);
    if (!found) {
        if (!index) return {scene.lights().environment(wi), scene.lights().pdf_environment(wi)};
        return match(light_at(scene, *index), [&](const auto &light) {
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>)
                return Emission{light.emitted(wi), light.pdf_direction(wi)};
            else return Emission{};
        });
    }
    const Hit<float> hit = scene.hit(ray, *found);
    if (hit.emitter < 0 || dot(hit.normal, wi) >= 0) return {};
    const Spectrum radiance = scene.lights().emitted(hit, -wi);
    if (!index) return {radiance, scene.lights().pdf_hit(p, hit, wi)};
    const auto *light = std::get_if<AreaLight>(&light_at(scene, *index));
    const bool is_this = light && static_cast<std::uint32_t>(hit.emitter) == *index;
    return is_this ? Emission{radiance, light->pdf_hit(p, hit, wi)} : Emission{};
}

nb::tuple eval_emitters(const RenderableScene &self, const Point &point, const Rows<3> &wi, Index index) {
    const Vec3f p = point_in(*self.scene, point);
    Table<float, 3> radiance(wi.shape(0));
    Table<float, 1> pdf(wi.shape(0));
    for (std::size_t i = 0; i < wi.shape(0); ++i) {
        const Emission a = emission(*self.scene, index, p, triple(wi, i));
        radiance.set(i, a.radiance);
        pdf.set(i, a.pdf);
    }
    return nb::make_tuple(std::move(radiance).to_numpy(), std::move(pdf).to_numpy());
}

} // namespace

void bind_lights(nb::module_ &m) {
    m.def("sample_emitters", &sample_emitters, "scene"_a, "point"_a, "u"_a, "emitter"_a = nb::none(),
          "Samples a light, or all of them picked by power, towards a point (3,) with u (N, 3) = which part, "
          "u.x, u.y: a dict of arrays wi (N, 3), radiance (N, 3), distance, pdf (0: no sample), delta and "
          "visible (N,).");
    m.def("eval_emitters", &eval_emitters, "scene"_a, "point"_a, "wi"_a, "emitter"_a = nb::none(),
          "Traces rays from a point along wi (N, 3): radiance (N, 3) and density (N,) of a light, or of all, "
          "in "
          "these directions.");
}

} // namespace lajolla
