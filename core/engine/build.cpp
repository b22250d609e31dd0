#include "engine/build.h"

#include "engine/described.h"
#include "engine/media.h"
#include "engine/recentre.h"
#include "engine/renderable.h"

namespace lajolla {

namespace {

// The dict under a key; an empty one, which means all defaults, where it is missing.
const Dict &read_dict(const Dict &description, const char *key) {
    static const Dict empty;
    const Value *const given = description.find(key);
    if (!given) return empty;
    const Dict *const dict = given->get_if<Dict>();
    if (!dict) throw UnexpectedValue(key, "a dict", *given);
    return *dict;
}

template <class Variant>
Variant read_variant(const Dict &description, const char *key) {
    const Dict &entry = read_dict(description, key);
    return entry.contains("type") ? variant_from<Variant>(entry, key) : Variant{};
}

// An index into a list of `count` entries, or -1.
std::int32_t read_id(const Dict &entry, const char *key, std::size_t count, const std::string &where) {
    std::int32_t id = -1;
    const Value *const given = entry.find(key);
    if (!given) return id;
    read_value(*given, id, where, ".", key);
    if (id < -1 || id >= static_cast<std::int64_t>(count))
        throw UnexpectedValue(where + "." + key,
                              count > 0 ? "-1 or an index below " + std::to_string(count) : "-1", *given);
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

// Materials and adapters refer to BSDFs, and to adapters that were read before.
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

void read_adapters(const Dict &description, SceneParts &parts) {
    for_each_entry(description, "adapters", [&](const Dict &entry, const std::string &where) {
        auto adapter = variant_from<Adapter>(entry, where);
        check_textures(adapter, parts.textures.size(), where);
        match(adapter, [&](const auto &a) {
            for_each_field<std::decay_t<decltype(a)>>([&](const auto &field) {
                if constexpr (std::is_same_v<std::decay_t<decltype(a.*field.member)>, MaterialId>)
                    check_material(a.*field.member, parts, where + "." + field.name);
            });
        });
        parts.adapters.push_back(std::move(adapter));
    });
}

Material read_material(const Dict &entry, const SceneParts &parts, const std::string &where) {
    Material material;
    for (const auto &[name, value] : entry) {
        if (name != "front" && name != "back")
            throw DescriptionError(where + ": unknown field '" + name + "' (known: front, back)");
        MaterialId &side = name == "front" ? material.front : material.back;
        read_value(value, side, where, ".", name);
        check_material(side, parts, where + "." + name);
    }
    return material;
}

Group read_group(const Dict &entry, std::size_t shapes, const std::string &where) {
    const Value *const given = entry.find("shapes");
    const List *const indices = given ? given->get_if<List>() : nullptr;
    if (!indices) throw DescriptionError(where + ": expected {'shapes': a list of indices}");
    Group group;
    for (const Value &item : *indices) {
        std::uint32_t id = 0;
        read_value(item, id, where, ".shapes");
        if (id >= shapes)
            throw UnexpectedValue(where + ".shapes", "an index below " + std::to_string(shapes), item);
        group.push_back(id);
    }
    return group;
}

Instance read_instance(const Dict &entry, std::size_t groups, const std::string &where) {
    const auto instance = model_from<Instance>(entry, where);
    if (static_cast<std::size_t>(instance.group) >= groups)
        throw DescriptionError(where + ".group: there is no group " + std::to_string(instance.group));
    return instance;
}

constexpr std::int32_t most_light_groups = 256;

// Models that have textures.
template <class Variant>
void read_textured(const Dict &description, const char *key, const std::vector<TextureModel> &textures,
                   std::vector<Variant> &list) {
    for_each_entry(description, key, [&](const Dict &entry, const std::string &where) {
        auto model = variant_from<Variant>(entry, where);
        check_textures(model, textures.size(), where); // earlier ones only: no texture reads itself
        list.push_back(std::move(model));
    });
}

// Textures, BSDFs and what is made of them.
void read_looks(const Dict &description, SceneParts &parts) {
    read_textured(description, "textures", parts.textures, parts.textures);
    read_textured(description, "bsdfs", parts.textures, parts.bsdfs);
    read_adapters(description, parts);
    parts.materials = read_list(description, "materials", [&](const Dict &entry, const std::string &where) {
        return read_material(entry, parts, where);
    });
}

// Embree multiplies coordinates with each other: cubes of lengths must be numbers, and those of curves'
// segments more than that.
constexpr float largest_shape = 4e12f;
struct CurveSizes {
    float least, most;
};
constexpr CurveSizes sizes_of(CurveBasis basis) {
    return basis == CurveBasis::linear ? CurveSizes{1e-6f, 3e6f} : CurveSizes{1e-12f, 3e9f};
}

std::string length_text(float length) { return text_of(Described<float>::write(length)); }

void check_size(const Shape &shape, const std::string &where) {
    const Bounds box = match(shape, [](const auto &s) { return s.bounds(); });
    const float reach = box.empty() ? 0 : max_component(max(abs(box.low), abs(box.high)));
    if (!(reach <= largest_shape))
        throw DescriptionError(where + ": the shape reaches coordinates of " + length_text(reach) +
                               "; rays can be traced up to " + length_text(largest_shape));
    const auto *curves = std::get_if<Curves>(&shape);
    if (!curves) return;
    const auto [least, most] = sizes_of(curves->basis);
    const float longest = curves->longest_segment();
    if (longest > most || (longest > 0 && longest < least))
        throw DescriptionError(where + ": the longest segment measures " + length_text(longest) +
                               "; such curves can be rendered from " + length_text(least) + " to " +
                               length_text(most));
}

// Small shapes are too small to be seen; a small scene would be all that is seen.
void check_scene_size(const Bounds &scene) {
    constexpr float smallest_scene = 1e-12f;
    const float size = scene.empty() ? 0 : max_component(scene.high - scene.low);
    if (size > 0 && size < smallest_scene)
        throw DescriptionError("shapes[0]: the whole scene measures " + length_text(size) +
                               "; rays can be traced in scenes of " + length_text(smallest_scene) +
                               " or more");
}

void read_shapes(const Dict &description, SceneParts &parts) {
    const std::size_t media = parts.media.size();
    parts.shapes = read_list(description, "shapes", [&](const Dict &entry, const std::string &where) {
        parts.slots.push_back({read_id(entry, "material", parts.materials.size(), where),
                               read_id(entry, "emitter", parts.lights.size(), where),
                               read_id(entry, "interior", media, where),
                               read_id(entry, "exterior", media, where)});
        return variant_from<Shape>(entry, where, {"material", "emitter", "interior", "exterior"});
    });
    parts.groups = read_list(description, "groups", [&](const Dict &entry, const std::string &where) {
        return read_group(entry, parts.shapes.size(), where);
    });
    parts.instances = read_list(description, "instances", [&](const Dict &entry, const std::string &where) {
        return read_instance(entry, parts.groups.size(), where);
    });
}

void read_lights(const Dict &description, SceneParts &parts) {
    for_each_entry(description, "emitters", [&](const Dict &entry, const std::string &where) {
        auto light = variant_from<Light>(entry, where, {"lightgroup"});
        check_textures(light, parts.textures.size(), where);
        parts.lights.push_back(std::move(light));
        std::int32_t group = 0;
        const Value *const given = entry.find("lightgroup");
        if (given) read_value(*given, group, where, ".", "lightgroup");
        if (group < 0 || group > most_light_groups)
            throw UnexpectedValue(where + ".lightgroup",
                                  "a number from 0 to " + std::to_string(most_light_groups), *given);
        parts.light_groups.push_back(group);
    });
}

// All that has a place in the world.
void read_places(const Dict &description, SceneParts &parts) {
    parts.lights.clear(), parts.light_groups.clear(), parts.slots.clear();
    read_lights(description, parts);
    parts.media = read_media(description);
    read_shapes(description, parts);
    const Dict &sensor = read_dict(description, "sensor");
    parts.camera_medium = read_id(sensor, "medium", parts.media.size(), "sensor");
    if (sensor.contains("type")) parts.camera = variant_from<Camera>(sensor, "sensor", {"medium"});
}

SceneParts read_parts(const Dict &description) {
    SceneParts parts;
    read_looks(description, parts);
    read_places(description, parts);
    constexpr int most_moves = 3; // from very far away, float32 determines the centre only step by step
    Origins origins;
    for (int moves = 0; moves < most_moves && origins.move(parts); ++moves)
        read_places(recentred(description, parts, origins), parts);
    parts.origin = origins.scene;
    for (std::size_t id = 0; id < parts.shapes.size(); ++id)
        check_size(parts.shapes[id], "shapes[" + std::to_string(id) + "]");
    check_scene_size(bounds_of(parts));
    parts.film = model_from<Film>(read_dict(description, "film"), "film");
    parts.filter = read_variant<PixelFilter>(description, "rfilter");
    return parts;
}

Output read_output(const Dict &description) {
    Output output{read_variant<Integrator>(description, "integrator"), {}, {}};
    output.others =
        read_list(description, "other_integrators", [](const Dict &entry, const std::string &where) {
            return variant_from<Integrator>(entry, where);
        });
    output.channels = read_list(description, "channels", [&](const Dict &entry, const std::string &where) {
        auto channel = model_from<Channel>(entry, where);
        if (static_cast<std::size_t>(channel.source) > output.others.size())
            throw DescriptionError(where + ".source: there is no integrator " +
                                   std::to_string(channel.source));
        if (channel.light_group >= 0 && channel.source != 0)
            throw DescriptionError(where + ".light_group: only the picture has light groups");
        return channel;
    });
    return output;
}

void check_light_groups(const Output &output, const SceneParts &parts) {
    std::int32_t last = 0;
    for (const std::int32_t group : parts.light_groups) last = std::max(last, group);
    for (const Channel &channel : output.channels)
        if (channel.light_group > last)
            throw DescriptionError("channels: no light is in the light group " +
                                   std::to_string(channel.light_group));
}

} // namespace

std::shared_ptr<RenderableScene> build_scene(const Dict &description) {
    auto result = std::make_shared<RenderableScene>();
    const auto sampler_model = read_variant<SamplerModel>(description, "sampler");
    match(sampler_model, [&](const auto &sampler) {
        result->sequence = sampler.kind;
        result->sample_count = sampler.sample_count;
        result->seed = sampler.seed;
    });
    result->output = read_output(description);
    SceneParts parts = read_parts(description);
    check_light_groups(result->output, parts);
    try {
        result->scene = std::make_shared<const Scene>(std::move(parts));
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(error.what());
    }
    return result;
}

std::shared_ptr<RenderableScene> with_output(const RenderableScene &scene, const Dict &description) {
    auto result = std::make_shared<RenderableScene>(scene);
    result->output = read_output(description);
    return result;
}

Dict schema() {
    return {{"bsdf", schema_of_list<Bsdf>()},
            {"adapter", schema_of_list<Adapter>()},
            {"texture", schema_of_list<TextureModel>()},
            {"emitter", schema_of_list<Light>()},
            {"medium", schema_of_list<Medium>()},
            {"phase", schema_of_list<Phase>()},
            {"volume", schema_of_list<VolumeModel>()},
            {"shape", schema_of_list<Shape>()},
            {"sensor", schema_of_list<Camera>()},
            {"film", schema_of_list<std::variant<Film>>()},
            {"rfilter", schema_of_list<PixelFilter>()},
            {"sampler", schema_of_list<SamplerModel>()},
            {"integrator", schema_of_list<Integrator>()}};
}

// Reads the fields alone, of every row: what a model's build() computes does not matter here.
bool transmissive(const Dict &bsdf) {
    std::string type;
    if (const Value *const given = bsdf.find("type")) read_value(*given, type, "bsdf.type");
    bool result = false;
    const auto look_at = [&](const Dict &one) {
        for_each_alternative<Bsdf>([&]<class Model>() {
            if (type != Model::name) return;
            Model model;
            read_model(model, one, "bsdf");
            result = result || model.traits().transmissive;
        });
    };
    const auto rows = row_count(bsdf);
    if (!rows) look_at(bsdf);
    for (std::size_t i = 0; i < rows.value_or(0); ++i) look_at(row_of(bsdf, i));
    return result;
}

Dict summary(const RenderableScene &scene) {
    const SceneParts &parts = scene.scene->parts();
    std::size_t triangles = 0;
    for (const Shape &shape : parts.shapes)
        if (const auto *mesh = std::get_if<TriangleMesh>(&shape)) triangles += mesh->mesh->triangles.size();
    Dict result{{"shapes", parts.shapes.size()}};
    if (!parts.instances.empty()) result.add("instances", parts.instances.size());
    result.add("triangles", triangles);
    result.add("bsdfs", parts.bsdfs.size());
    result.add("emitters", parts.lights.size());
    result.add("textures", parts.textures.size());
    result.add("media", parts.media.size());
    result.add("bytes", scene.scene->bytes());
    return result;
}

} // namespace lajolla
