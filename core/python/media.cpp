// Phase functions, volumes and media by themselves, outside of scenes.

#include "python/bindings.h"

#include "engine/media.h"
#include "python/arrays.h"
#include "python/values.h"

namespace lajolla {

namespace {

using namespace nb::literals;

void require_index(std::int32_t index, std::size_t count, const char *what) {
    if (index < 0 || static_cast<std::size_t>(index) >= count)
        throw nb::index_error((std::string("there is no such ") + what).c_str());
}

// The phase function with this id where its volumes are read.
PhaseLobe lobe_at(const Media &media, std::int32_t phase, Vec3f position) {
    require_index(phase, media.phases().size(), "phase function");
    return prepare(media.phases(), {phase}, VolumeReader(media.volumes(), position));
}

nb::tuple phase_sample_many(const Media &self, std::int32_t phase, const Rows<3> &wo, const Rows<3> &u,
                            const Rows<3> &position) {
    const std::size_t n = u.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    require_one_or(position.shape(0), n, "position");
    Table<float, 3> wi(n);
    Table<float, 1> pdf(n);
    for (std::size_t i = 0; i < n; ++i) {
        const PhaseSample s =
            lobe_at(self, phase, triple(position, i)).sample(triple(wo, i), u(i, 0), {u(i, 1), u(i, 2)});
        wi.set(i, s.wi);
        pdf.set(i, s.pdf);
    }
    return nb::make_tuple(std::move(wi).to_numpy(), std::move(pdf).to_numpy());
}

nb::object phase_eval_many(const Media &self, std::int32_t phase, const Rows<3> &wo, const Rows<3> &wi,
                           const Rows<3> &position) {
    require_one_or(wo.shape(0), wi.shape(0), "wo");
    require_one_or(position.shape(0), wi.shape(0), "position");
    return tabulate<1>(wi.shape(0), [&](std::size_t i) {
        return lobe_at(self, phase, triple(position, i)).eval(triple(wo, i), triple(wi, i));
    });
}

nb::object phase_area_many(const Media &self, std::int32_t phase, const Rows<3> &wo,
                           const Rows<3> &position) {
    require_one_or(position.shape(0), wo.shape(0), "position");
    return tabulate<1>(wo.shape(0), [&](std::size_t i) {
        return lobe_at(self, phase, triple(position, i)).projected_area(triple(wo, i));
    });
}

nb::object volume_many(const Media &self, std::int32_t volume, const Rows<3> &positions) {
    require_index(volume, self.volumes().size(), "volume");
    Volume<Spectrum> handle;
    handle.id = volume;
    return tabulate<3>(positions.shape(0), [&](std::size_t i) {
        return VolumeReader(self.volumes(), triple(positions, i))(handle);
    });
}

nb::dict coefficients_many(const Media &self, std::int32_t medium, const Rows<3> &positions,
                           const Rows<3> &wo) {
    require_index(medium, self.size(), "medium");
    const std::size_t n = positions.shape(0);
    require_one_or(wo.shape(0), n, "wo");
    Table<float, 3> sigma_a(n), sigma_s(n), emission(n);
    for (std::size_t i = 0; i < n; ++i) {
        const Coefficients c = self.coefficients(medium, triple(positions, i), triple(wo, i));
        sigma_a.set(i, c.sigma_a);
        sigma_s.set(i, c.sigma_s);
        emission.set(i, c.emission);
    }
    nb::dict result;
    result["sigma_a"] = std::move(sigma_a).to_numpy();
    result["sigma_s"] = std::move(sigma_s).to_numpy();
    result["emission"] = std::move(emission).to_numpy();
    return result;
}

} // namespace

void bind_media(nb::module_ &m) {
    nb::class_<Media>(m, "Media", "Phase functions, volumes and media by themselves, outside of scenes.")
        .def(nb::new_([](const nb::dict &description) { return with_dict(description, read_media); }),
             "description"_a, "The lists \"volumes\", \"phases\" and \"media\" of a scene's description.")
        .def("phase_sample_many", &phase_sample_many, "phase"_a, "wo"_a, "u"_a, "position"_a,
             "Samples wi given wo (1 or N, 3) with u (N, 3) = u_lobe, u.x, u.y at position (1 or N, 3): wi "
             "(N, 3) and pdf (N,) per solid angle, which is the phase function's value.")
        .def("phase_eval_many", &phase_eval_many, "phase"_a, "wo"_a, "wi"_a, "position"_a,
             "Values (N,) for wo (1 or N, 3), wi (N, 3).")
        .def("phase_area_many", &phase_area_many, "phase"_a, "wo"_a, "position"_a,
             "The factors (N,) of the extinction along wo (N, 3).")
        .def("volume_many", &volume_many, "volume"_a, "positions"_a, "A volume's values (N, 3).")
        .def("coefficients_many", &coefficients_many, "medium"_a, "positions"_a, "wo"_a,
             "sigma_a, sigma_s and emission (N, 3) of a medium.");
}

} // namespace lajolla
