#include "engine/build.h"

#include <algorithm>
#include <array>

#include "engine/described.h"
#include "engine/entries.h"
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

// Textures, BSDFs and what is made of them.
void read_looks(const Dict &description, SceneParts &parts) {
    for_each_entry(description, "textures", [&](const Dict &entry, const std::string &where) {
        auto &textures = parts.textures.edit(); // a texture may read earlier ones, so none reads itself
        textures.push_back(read_texture(entry, textures.size(), where));
    });
    parts.bsdfs = read_list(description, "bsdfs", [&](const Dict &entry, const std::string &where) {
        return read_bsdf(entry, parts.textures.size(), where);
    });
    for_each_entry(description, "adapters", [&](const Dict &entry, const std::string &where) {
        auto adapter = read_adapter(entry, parts, parts.adapters.size(), where);
        parts.adapters.edit().push_back(std::move(adapter));
    });
    parts.materials = read_list(description, "materials", [&](const Dict &entry, const std::string &where) {
        return read_material(entry, parts, where);
    });
}

void read_lights(const Dict &description, SceneParts &parts) {
    std::vector<Light> lights;
    std::vector<std::int32_t> groups;
    for_each_entry(description, "emitters", [&](const Dict &entry, const std::string &where) {
        auto [light, group] = read_light(entry, parts, where);
        lights.push_back(std::move(light));
        groups.push_back(group);
    });
    parts.lights = std::move(lights), parts.light_groups = std::move(groups);
}

void read_shapes(const Dict &description, SceneParts &parts) {
    std::vector<ShapeSlot> slots;
    std::vector<Compositing> compositing;
    parts.shapes = read_list(description, "shapes", [&](const Dict &entry, const std::string &where) {
        slots.push_back(read_slot(entry, parts, where));
        compositing.push_back(read_compositing(entry, where));
        return read_shape(entry, where);
    });
    parts.slots = std::move(slots), parts.compositing = std::move(compositing);
    parts.groups = read_list(description, "groups", [&](const Dict &entry, const std::string &where) {
        return read_group(entry, parts.shapes.size(), where);
    });
    parts.instances = read_list(description, "instances", [&](const Dict &entry, const std::string &where) {
        return read_instance(entry, parts.groups.size(), where);
    });
}

// All that has a place in the world.
void read_places(const Dict &description, SceneParts &parts) {
    read_lights(description, parts);
    parts.media = std::make_shared<const Media>(read_media(description));
    read_shapes(description, parts);
    const Dict &sensor = read_dict(description, "sensor");
    parts.camera_medium = read_camera_medium(sensor, parts);
    parts.camera = read_camera(sensor);
}

SceneParts read_parts(const Dict &description, Origins &origins) {
    SceneParts parts;
    read_looks(description, parts);
    read_places(description, parts);
    constexpr int most_moves = 3; // from very far away, float32 determines the centre only step by step
    for (int moves = 0; moves < most_moves && origins.move(parts); ++moves)
        read_places(recentred(description, parts, origins), parts);
    parts.origin = origins.scene;
    for (std::size_t id = 0; id < parts.shapes.size(); ++id)
        check_size(parts.shapes[id], "shapes[" + std::to_string(id) + "]");
    check_scene_size(bounds_of(parts));
    parts.film = model_from<Film>(read_dict(description, "film"), "film");
    parts.filter = read_variant<PixelFilter>(description, "rfilter");
    if (const Value *const robust = description.find("robust"))
        read_value(*robust, parts.robust.emplace(), "robust");
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

void match_channels(RenderableScene &scene) {
    constexpr std::array shadows{Recorded::catcher, Recorded::shadowed, Recorded::unshadowed};
    std::vector<Channel> &channels = scene.output.channels;
    std::erase_if(channels, [&](const Channel &channel) {
        return std::ranges::find(shadows, channel.recorded) != shadows.end();
    });
    if (!scene.scene->has_catchers()) return;
    for (std::size_t i = 0, count = channels.size(); i < count; ++i)
        for (const Recorded recorded : shadows) {
            if (channels[i].recorded != Recorded::alpha || channels[i].squared) continue;
            const std::string name = choices(recorded)[static_cast<std::size_t>(recorded)];
            channels.push_back({channels[i].label + "." + name, channels[i].source, recorded});
        }
}

std::shared_ptr<RenderableScene> build_scene(const Dict &description) {
    auto result = std::make_shared<RenderableScene>();
    result->set_sampler(read_variant<SamplerModel>(description, "sampler"));
    result->output = read_output(description);
    Origins origins;
    SceneParts parts = read_parts(description, origins);
    if (origins.any_moved()) result->origins = std::make_shared<const Origins>(std::move(origins));
    check_light_groups(result->output, parts);
    try {
        result->scene = std::make_shared<const Scene>(std::move(parts));
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(error.what());
    }
    match_channels(*result);
    return result;
}

std::shared_ptr<RenderableScene> with_output(const RenderableScene &scene, const Dict &description) {
    auto result = std::make_shared<RenderableScene>(scene);
    result->output = read_output(description);
    match_channels(*result);
    return result;
}

Dict schema() {
    return {{"bsdf", schema_of_list<Bsdf>()},
            {"adapter", schema_of_list<Adapter>()},
            {"material", schema_of_list<std::variant<Material>>()},
            {"texture", schema_of_list<TextureModel>()},
            {"emitter", schema_of_list<Light>()},
            {"medium", schema_of_list<Medium>()},
            {"phase", schema_of_list<Phase>()},
            {"volume", schema_of_list<VolumeModel>()},
            {"shape", schema_of_list<Shape, Compositing>()},
            {"instance", schema_of_list<std::variant<Instance>>()},
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
    result.add("media", parts.media->size());
    result.add("bytes", scene.scene->bytes());
    return result;
}

} // namespace lajolla
