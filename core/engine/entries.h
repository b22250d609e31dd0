#pragma once
// Single entries of a description's lists, checked against the parts of the scene that they refer to. All of
// these throw DescriptionError.

#include "engine/describe.h"
#include "scene/scene.h"

namespace lajolla {

// Models that have textures: each must be one of the first `count`.
TextureModel read_texture(const Dict &entry, std::size_t count, const std::string &where);
Bsdf read_bsdf(const Dict &entry, std::size_t textures, const std::string &where);
// It may contain the first `count` of the scene's adapters.
Adapter read_adapter(const Dict &entry, const SceneParts &parts, std::size_t count, const std::string &where);
Material read_material(const Dict &entry, const SceneParts &parts, const std::string &where);

struct GroupedLight {
    Light light;
    std::int32_t group; // from 1; 0 for none
};
GroupedLight read_light(const Dict &entry, const SceneParts &parts, const std::string &where);

// An index into a list of `count` entries, or -1.
std::int32_t read_id(const Dict &entry, const char *key, std::size_t count, const std::string &where);
ShapeSlot read_slot(const Dict &entry, const SceneParts &parts, const std::string &where);
Compositing read_compositing(const Dict &entry, const std::string &where);
Shape read_shape(const Dict &entry, const std::string &where);
// Refuses shapes of a size that rays cannot be traced in.
void check_size(const Shape &shape, const std::string &where);
void check_scene_size(const Bounds &scene);

Group read_group(const Dict &entry, std::size_t shapes, const std::string &where);
Instance read_instance(const Dict &entry, std::size_t groups, const std::string &where);

Camera read_camera(const Dict &entry);
std::int32_t read_camera_medium(const Dict &entry, const SceneParts &parts);

} // namespace lajolla
