#include "engine/entries.h"

#include "engine/described.h"

namespace lajolla {

namespace {

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

// Materials and adapters refer to BSDFs, and to the first of the adapters.
void check_material(MaterialId id, const SceneParts &parts, std::size_t adapters, const std::string &where) {
    const auto known = [](std::int32_t index, std::size_t count) {
        return index >= -1 && index < static_cast<std::int64_t>(count);
    };
    if (!known(id.bsdf, parts.bsdfs.size()))
        throw DescriptionError(where + ": there is no bsdf " + std::to_string(id.bsdf));
    if (!known(id.adapter, adapters))
        throw DescriptionError(where + ": there is no adapter " + std::to_string(id.adapter) +
                               " before this");
}

constexpr std::int32_t most_light_groups = 256;

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

} // namespace

TextureModel read_texture(const Dict &entry, std::size_t count, const std::string &where) {
    auto texture = variant_from<TextureModel>(entry, where);
    check_textures(texture, count, where);
    return texture;
}

Bsdf read_bsdf(const Dict &entry, std::size_t textures, const std::string &where) {
    auto bsdf = variant_from<Bsdf>(entry, where);
    check_textures(bsdf, textures, where);
    return bsdf;
}

Adapter read_adapter(const Dict &entry, const SceneParts &parts, std::size_t count,
                     const std::string &where) {
    auto adapter = variant_from<Adapter>(entry, where);
    check_textures(adapter, parts.textures.size(), where);
    match(adapter, [&](const auto &a) {
        for_each_field<std::decay_t<decltype(a)>>([&](const auto &field) {
            if constexpr (std::is_same_v<std::decay_t<decltype(a.*field.member)>, MaterialId>)
                check_material(a.*field.member, parts, count, where + "." + field.name);
        });
    });
    return adapter;
}

Material read_material(const Dict &entry, const SceneParts &parts, const std::string &where) {
    const auto material = model_from<Material>(entry, where);
    check_material(material.front, parts, parts.adapters.size(), where + ".front");
    check_material(material.back, parts, parts.adapters.size(), where + ".back");
    return material;
}

GroupedLight read_light(const Dict &entry, const SceneParts &parts, const std::string &where) {
    GroupedLight result{variant_from<Light>(entry, where, {"lightgroup"}), 0};
    check_textures(result.light, parts.textures.size(), where);
    const Value *const given = entry.find("lightgroup");
    if (given) read_value(*given, result.group, where, ".", "lightgroup");
    if (result.group < 0 || result.group > most_light_groups)
        throw UnexpectedValue(where + ".lightgroup",
                              "a number from 0 to " + std::to_string(most_light_groups), *given);
    return result;
}

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

ShapeSlot read_slot(const Dict &entry, const SceneParts &parts, const std::string &where) {
    const std::size_t media = parts.media->size();
    return {read_id(entry, "material", parts.materials.size(), where),
            read_id(entry, "emitter", parts.lights.size(), where), read_id(entry, "interior", media, where),
            read_id(entry, "exterior", media, where)};
}

Compositing read_compositing(const Dict &entry, const std::string &where) {
    Compositing result;
    for_each_field<Compositing>([&](const auto &field) {
        if (const Value *const given = entry.find(field.name))
            read_value(*given, result.*field.member, where, ".", field.name);
    });
    return result;
}

Shape read_shape(const Dict &entry, const std::string &where) {
    return variant_from<Shape>(
        entry, where,
        {"material", "emitter", "interior", "exterior", "visible_to_camera", "holdout", "shadow_catcher"});
}

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

Camera read_camera(const Dict &entry) {
    return entry.contains("type") ? variant_from<Camera>(entry, "sensor", {"medium"}) : Camera{};
}

std::int32_t read_camera_medium(const Dict &entry, const SceneParts &parts) {
    return read_id(entry, "medium", parts.media->size(), "sensor");
}

} // namespace lajolla
