#include "python/scene.h"

#include <memory>
#include <mutex>

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include "python/coated.h"
#include "python/describe.h"
#include "python/lists.h"
#include "python/media.h"
#include "python/meshes.h"

namespace lajolla {

// An index of a BSDF, -1 for black, or {"adapter": index}.
template <>
struct Described<MaterialId> {
    static constexpr const char *type = "material", *expected = "an index or {'adapter': index}";
    static bool read(nb::handle source, MaterialId &value) {
        if (const auto index = read_handle(source, "adapter")) {
            value = {-1, *index};
            return true;
        }
        value.adapter = -1;
        return Described<std::int32_t>::read(source, value.bsdf);
    }
    static nb::object write(MaterialId value) { return nb::int_(value.bsdf); }
};

namespace {

using namespace nb::literals;

// The dict under a key; an empty one, which means all defaults, where it is missing.
nb::dict read_dict(const nb::dict &description, const char *key) {
    if (!description.contains(key)) return {};
    const nb::object entry = description[key];
    if (!nb::isinstance<nb::dict>(entry)) throw_unexpected(key, "a dict", entry);
    return nb::cast<nb::dict>(entry);
}

template <class Variant>
Variant read_variant(const nb::dict &description, const char *key) {
    const nb::dict entry = read_dict(description, key);
    return entry.contains("type") ? variant_from<Variant>(entry, key) : Variant{};
}

// An index into a list of `count` entries, or -1.
std::int32_t read_id(const nb::dict &entry, const char *key, std::size_t count, const std::string &where) {
    std::int32_t id = -1;
    if (entry.contains(key)) read_value(entry[key], id, where + "." + key);
    if (id < -1 || id >= static_cast<std::int64_t>(count))
        throw_unexpected(where + "." + key,
                         count > 0 ? "-1 or an index below " + std::to_string(count) : "-1", entry[key]);
    return id;
}

template <class Variant>
void check_textures(const Variant &variant, std::size_t count, const std::string &where);

template <class T>
void check_texture(const T &value, std::size_t count, const std::string &where) {
    if constexpr (std::is_same_v<T, BareBsdf>) check_textures(value, count, where);
    else if constexpr (requires { value.id; })
        if (value.id >= static_cast<std::int64_t>(count))
            throw DescriptionError(where + ": there is no texture " + std::to_string(value.id) +
                                   " before this");
}

// Every texture handle of a model must name one of the first `count` textures.
template <class Variant>
void check_textures(const Variant &variant, std::size_t count, const std::string &where) {
    match(variant, [&](const auto &model) {
        for_each_field<std::decay_t<decltype(model)>>(
            [&](const auto &field) { check_texture(model.*field.member, count, where + "." + field.name); });
    });
}

// Materials and adapters hold BSDFs, and adapters that were read before.
void check_material(MaterialId id, const SceneParts &parts, const std::string &where) {
    const auto known = [](std::int32_t index, std::size_t count) {
        return index >= -1 && index < static_cast<std::int64_t>(count);
    };
    if (!known(id.bsdf, parts.bsdfs.size()))
        throw DescriptionError(where + ": there is no bsdf " + std::to_string(id.bsdf));
    if (!known(id.adapter, parts.adapters.size()))
        throw DescriptionError(where + ": there is no adapter " + std::to_string(id.adapter) +
                               " before this");
}

void read_adapters(const nb::dict &description, SceneParts &parts) {
    read_list(description, "adapters", [&](const nb::dict &entry, const std::string &where) {
        auto adapter = variant_from<Adapter>(entry, where);
        check_textures(adapter, parts.textures.size(), where);
        match(adapter, [&](const auto &a) {
            for_each_field<std::decay_t<decltype(a)>>([&](const auto &field) {
                if constexpr (std::is_same_v<std::decay_t<decltype(a.*field.member)>, MaterialId>)
                    check_material(a.*field.member, parts, where + "." + field.name);
            });
        });
        parts.adapters.push_back(std::move(adapter));
        return 0;
    });
}

Material read_material(const nb::dict &entry, const SceneParts &parts, const std::string &where) {
    Material material;
    for (const auto &[key, value] : entry) {
        const std::string name = detail::text_of_key(key);
        if (name != "front" && name != "back")
            throw DescriptionError(where + ": unknown field '" + name + "' (known: front, back)");
        MaterialId &side = name == "front" ? material.front : material.back;
        read_value(value, side, where + "." + name);
        check_material(side, parts, where + "." + name);
    }
    return material;
}

Group read_group(const nb::dict &entry, std::size_t shapes, const std::string &where) {
    Group group;
    if (!entry.contains("shapes") || !nb::isinstance<nb::list>(entry["shapes"]))
        throw DescriptionError(where + ": expected {'shapes': a list of indices}");
    for (const nb::handle item : nb::cast<nb::list>(entry["shapes"])) {
        std::uint32_t id = 0;
        read_value(item, id, where + ".shapes");
        if (id >= shapes)
            throw_unexpected(where + ".shapes", "an index below " + std::to_string(shapes), item);
        group.push_back(id);
    }
    return group;
}

Instance read_instance(const nb::dict &entry, std::size_t groups, const std::string &where) {
    const auto instance = model_from<Instance>(entry, where);
    if (static_cast<std::size_t>(instance.group) >= groups)
        throw DescriptionError(where + ".group: there is no group " + std::to_string(instance.group));
    return instance;
}

SceneParts read_parts(const nb::dict &description) {
    SceneParts parts;
    parts.textures =
        read_list(description, "textures",
                  [&, count = std::size_t(0)](const nb::dict &entry, const std::string &where) mutable {
                      auto texture = variant_from<TextureModel>(entry, where);
                      check_textures(texture, count++, where); // earlier ones only: no texture reads itself
                      return texture;
                  });
    const std::size_t textures = parts.textures.size();
    parts.bsdfs = read_list(description, "bsdfs", [&](const nb::dict &entry, const std::string &where) {
        auto bsdf = variant_from<Bsdf>(entry, where);
        check_textures(bsdf, textures, where);
        return bsdf;
    });
    read_adapters(description, parts);
    parts.materials =
        read_list(description, "materials", [&](const nb::dict &entry, const std::string &where) {
            return read_material(entry, parts, where);
        });
    parts.lights = read_list(description, "emitters", [&](const nb::dict &entry, const std::string &where) {
        auto light = variant_from<Light>(entry, where);
        check_textures(light, textures, where);
        return light;
    });
    parts.media = read_media(description);
    const std::size_t media = parts.media.size();
    parts.shapes = read_list(description, "shapes", [&](const nb::dict &entry, const std::string &where) {
        parts.slots.push_back({read_id(entry, "material", parts.materials.size(), where),
                               read_id(entry, "emitter", parts.lights.size(), where),
                               read_id(entry, "interior", media, where),
                               read_id(entry, "exterior", media, where)});
        return variant_from<Shape>(entry, where, {"material", "emitter", "interior", "exterior"});
    });
    parts.groups = read_list(description, "groups", [&](const nb::dict &entry, const std::string &where) {
        return read_group(entry, parts.shapes.size(), where);
    });
    parts.instances =
        read_list(description, "instances", [&](const nb::dict &entry, const std::string &where) {
            return read_instance(entry, parts.groups.size(), where);
        });
    const nb::dict sensor = read_dict(description, "sensor");
    parts.camera_medium = read_id(sensor, "medium", media, "sensor");
    if (sensor.contains("type")) parts.camera = variant_from<Camera>(sensor, "sensor", {"medium"});
    parts.film = model_from<Film>(read_dict(description, "film"), "film");
    parts.filter = read_variant<PixelFilter>(description, "rfilter");
    return parts;
}

Output read_output(const nb::dict &description) {
    Output output{read_variant<Integrator>(description, "integrator"), {}, {}};
    output.others =
        read_list(description, "other_integrators", [](const nb::dict &entry, const std::string &where) {
            return variant_from<Integrator>(entry, where);
        });
    output.channels =
        read_list(description, "channels", [&](const nb::dict &entry, const std::string &where) {
            auto channel = model_from<Channel>(entry, where);
            if (static_cast<std::size_t>(channel.source) > output.others.size())
                throw DescriptionError(where + ".source: there is no integrator " +
                                       std::to_string(channel.source));
            return channel;
        });
    return output;
}

std::unique_ptr<RenderableScene> make_scene(const nb::dict &description) {
    auto result = std::make_unique<RenderableScene>();
    const auto sampler_model = read_variant<SamplerModel>(description, "sampler");
    match(sampler_model, [&](const auto &sampler) {
        result->sequence = sampler.kind;
        result->sample_count = sampler.sample_count;
        result->seed = sampler.seed;
    });
    result->output = read_output(description);
    SceneParts parts = read_parts(description);
    try {
        const nb::gil_scoped_release release;
        result->scene = std::make_unique<const Scene>(std::move(parts));
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(error.what());
    }
    return result;
}

nb::dict summary(const RenderableScene &self) {
    const SceneParts &parts = self.scene->parts();
    std::size_t triangles = 0;
    for (const Shape &shape : parts.shapes)
        if (const auto *mesh = std::get_if<TriangleMesh>(&shape)) triangles += mesh->mesh->triangles.size();
    nb::dict result;
    result["shapes"] = parts.shapes.size();
    if (!parts.instances.empty()) result["instances"] = parts.instances.size();
    result["triangles"] = triangles;
    result["bsdfs"] = parts.bsdfs.size();
    result["emitters"] = parts.lights.size();
    result["textures"] = parts.textures.size();
    result["media"] = parts.media.size();
    result["bytes"] = self.scene->bytes();
    return result;
}

// The running sum of a render; every add() continues it.
class Render {
public:
    Render(const RenderableScene &scene, std::optional<std::uint32_t> seed)
        : scene_(scene), seed_(seed.value_or(scene.seed)), sums_(scene.output.channel_count() * pixels()) {}

    bool add(std::uint32_t first, std::uint32_t count, int threads, bool one_lane) {
        const std::lock_guard one_at_a_time(adding_);
        std::vector<double> next = sums_; // only add() writes sums_
        progress_.pixels = 0;
        const auto report = lajolla::render(*scene_.scene, scene_.output,
                                            {scene_.sequence, seed_, first, count, threads, one_lane}, next, progress_);
        if (!report) {
            progress_.cancelled = false;
            return false;
        }
        const std::lock_guard lock(results_);
        sums_ = std::move(next);
        samples_ += count;
        rays_ += report->rays;
        nonfinite_ += report->nonfinite;
        for (const SampleId &id : report->nonfinite_samples)
            if (nonfinite_list_.size() < Report::kept_samples)
                nonfinite_list_.emplace_back(id.x, id.y, id.index);
        return true;
    }
    void cancel() { progress_.cancelled = true; }
    double progress() const { return static_cast<double>(progress_.pixels) / static_cast<double>(pixels()); }
    nb::object image() const {
        const std::lock_guard lock(results_);
        auto values = std::make_unique<float[]>(sums_.size());
        const double scale = samples_ > 0 ? 1 / static_cast<double>(samples_) : 0;
        for (std::size_t i = 0; i < sums_.size(); ++i) values[i] = static_cast<float>(sums_[i] * scale);
        float *data = values.release();
        const nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<float *>(p); });
        const Film &film = scene_.scene->film();
        return nb::cast(nb::ndarray<nb::numpy, float>(data,
                                                      {static_cast<std::size_t>(film.crop_height),
                                                       static_cast<std::size_t>(film.crop_width),
                                                       scene_.output.channel_count()},
                                                      owner));
    }
    std::uint64_t samples() const { return locked(samples_); }
    std::uint64_t rays() const { return locked(rays_); }
    std::uint64_t nonfinite() const { return locked(nonfinite_); }
    auto nonfinite_list() const { return locked(nonfinite_list_); }

private:
    std::size_t pixels() const {
        const Film &film = scene_.scene->film();
        return static_cast<std::size_t>(film.crop_width) * static_cast<std::size_t>(film.crop_height);
    }

    template <class T>
    T locked(const T &value) const {
        const std::lock_guard lock(results_);
        return value;
    }

    const RenderableScene &scene_; // kept alive by Python
    std::mutex adding_;
    mutable std::mutex results_; // of everything below: add() runs without the interpreter's lock
    std::uint32_t seed_;
    std::vector<double> sums_;
    std::uint64_t samples_ = 0, rays_ = 0, nonfinite_ = 0;
    std::vector<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> nonfinite_list_;
    Progress progress_;
};

std::tuple<float, float, float> replay_sample(const RenderableScene &self, std::uint32_t seed,
                                              std::uint32_t x, std::uint32_t y, std::uint32_t sample) {
    Tracer tracer(self.scene->accel());
    const Spectrum value =
        sample_radiance(*self.scene, self.output.integrator, self.sequence, seed, {x, y, sample}, tracer);
    return {value.x, value.y, value.z};
}

// Recorded rays for bench/limit.
struct RayRecording {
    const RenderableScene &scene;
    Recording rays;
    std::size_t size() const {
        std::size_t sum = 0;
        for (const auto &tile : rays) sum += tile.size();
        return sum;
    }
};

} // namespace

nb::dict schema() {
    nb::dict kinds;
    kinds["bsdf"] = schema_of_list<Bsdf>();
    kinds["adapter"] = schema_of_list<Adapter>();
    kinds["texture"] = schema_of_list<TextureModel>();
    kinds["emitter"] = schema_of_list<Light>();
    kinds["medium"] = schema_of_list<Medium>();
    kinds["phase"] = schema_of_list<Phase>();
    kinds["volume"] = schema_of_list<VolumeModel>();
    kinds["shape"] = schema_of_list<Shape>();
    kinds["sensor"] = schema_of_list<Camera>();
    kinds["film"] = schema_of_list<std::variant<Film>>();
    kinds["rfilter"] = schema_of_list<PixelFilter>();
    kinds["sampler"] = schema_of_list<SamplerModel>();
    kinds["integrator"] = schema_of_list<Integrator>();
    return kinds;
}

// Reads the fields alone: what a model's build() computes does not matter here.
static bool transmissive(const nb::dict &description) {
    bool result = false;
    for_each_alternative<Bsdf>([&]<class Model>() {
        if (nb::cast<std::string>(description["type"]) != Model::name) return;
        Model model;
        read_model(model, description, "bsdf");
        result = model.traits().transmissive;
    });
    return result;
}

void bind_scene(nb::module_ &m) {
    m.def("transmissive", &transmissive, "bsdf"_a,
          "Whether light passes through a surface with the BSDF of a description.");
    nb::class_<RenderableScene>(m, "Scene", "A scene that can be rendered; it never changes.")
        .def(nb::new_(&make_scene), "description"_a,
             "Builds the scene that a description holds. Raises DescriptionError.")
        .def_prop_ro(
            "width", [](const RenderableScene &s) { return s.scene->film().crop_width; },
            "of the crop window")
        .def_prop_ro(
            "height", [](const RenderableScene &s) { return s.scene->film().crop_height; },
            "of the crop window")
        .def_prop_ro(
            "crop_offset",
            [](const RenderableScene &s) {
                return std::tuple(s.scene->film().crop_offset_x, s.scene->film().crop_offset_y);
            },
            "position (x, y) of the crop window on the film")
        .def_prop_ro(
            "channels",
            [](const RenderableScene &s) {
                std::vector<std::string> labels;
                for (const Channel &channel : s.output.channels) labels.push_back(channel.label);
                return labels;
            },
            "labels of the channels that are rendered beside red, green and blue")
        .def_ro("sample_count", &RenderableScene::sample_count, "samples per pixel that the scene asks for")
        .def_ro("seed", &RenderableScene::seed, "seed that the scene asks for")
        .def("summary", &summary, "Counts of what is in it, and its size in bytes.");

    nb::class_<Render>(m, "Render", "The running mean of a scene's samples.")
        .def(nb::init<const RenderableScene &, std::optional<std::uint32_t>>(), "scene"_a,
             "seed"_a = nb::none(), nb::keep_alive<1, 2>())
        .def("add", &Render::add, "first_sample"_a, "count"_a, "threads"_a = 0, "one_lane"_a = false,
             nb::call_guard<nb::gil_scoped_release>(),
             "Adds samples first_sample ... first_sample + count - 1 of every pixel. Returns False, and "
             "changes nothing, "
             "where cancel() was called meanwhile. threads = 0 uses them all; one_lane follows one path after the "
             "other, which gives the same bits.")
        .def("cancel", &Render::cancel, "Stops add(), from another thread.")
        .def_prop_ro("progress", &Render::progress, "Finished fraction of the running add().")
        .def("image", &Render::image,
             "Mean of the samples: float32 (height, width, 3 + number of channels); the first three are "
             "linear "
             "sRGB.")
        .def_prop_ro("samples", &Render::samples, "Samples per pixel so far.")
        .def_prop_ro("rays", &Render::rays, "Rays traced so far.")
        .def_prop_ro("nonfinite", &Render::nonfinite,
                     "Samples that were NaN or infinite; they count as black.")
        .def_prop_ro("nonfinite_list", &Render::nonfinite_list, "(x, y, sample) of the first of them.");

    nb::class_<RayRecording>(m, "RayRecording", "The rays of a render, to be traced again without shading.")
        .def("__len__", &RayRecording::size)
        .def(
            "replay",
            [](const RayRecording &self, int threads) {
                return replay_seconds(*self.scene.scene, self.rays, threads);
            },
            "threads"_a = 0, nb::call_guard<nb::gil_scoped_release>(),
            "Seconds that the ray tracer alone takes.");
    m.def(
        "record_rays",
        [](const RenderableScene &scene, std::uint32_t count, int threads) {
            return std::make_unique<RayRecording>(
                scene, record(*scene.scene, scene.output, {scene.sequence, scene.seed, 0, count, threads}));
        },
        "scene"_a, "count"_a, "threads"_a = 0, nb::keep_alive<0, 1>(),
        nb::call_guard<nb::gil_scoped_release>(), "Renders `count` samples per pixel and keeps every ray.");
    m.def("sample_radiance", &replay_sample, "scene"_a, "seed"_a, "x"_a, "y"_a, "sample"_a,
          "Radiance (r, g, b) of one sample of one pixel; x and y count over the whole film.");
}

} // namespace lajolla
