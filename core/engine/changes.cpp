#include <charconv>

#include "engine/build.h"
#include "engine/described.h"
#include "engine/entries.h"
#include "engine/media.h"
#include "engine/renderable.h"

namespace lajolla {

namespace {

// "bsdfs[3]", or "sensor" without an index.
struct EntryName {
    std::string list;
    std::size_t index = 0;
};
EntryName parsed(const std::string &where) {
    const std::size_t bracket = where.find('[');
    if (bracket == std::string::npos) return {where};
    EntryName name{where.substr(0, bracket)};
    const char *const end = where.data() + where.size();
    const auto [rest, error] = std::from_chars(where.data() + bracket + 1, end, name.index);
    if (error != std::errc{} || std::string_view(rest, end) != "]")
        throw DescriptionError(where + ": there is no such entry");
    return name;
}

// Replaces an item of a list, or adds one at its end.
template <class T>
void put(SharedVector<T> &list, std::size_t index, T item, const std::string &where) {
    if (index > list.size()) throw DescriptionError(where + ": there is no such entry");
    if (index == list.size()) list.edit().push_back(std::move(item));
    else list.edit()[index] = std::move(item);
}

class Changes {
public:
    explicit Changes(const RenderableScene &scene)
        : result_(std::make_shared<RenderableScene>(scene)), before_(scene.scene.get()),
          parts_(scene.scene->parts()) {}

    void apply(const std::string &where, const Dict &entry);
    std::shared_ptr<RenderableScene> result() &&; // null if the scene has to be moved

private:
    bool change_looks(const EntryName &name, const Dict &entry, const std::string &where);
    bool change_places(const EntryName &name, const Dict &entry, const std::string &where);
    bool change_output(const EntryName &name, const Dict &entry, const std::string &where);
    void change_shape(std::size_t index, const Dict &entry, const std::string &where);
    Dict placed(const char *key, const Dict &entry) const;
    bool has_moved();

    std::shared_ptr<RenderableScene> result_;
    const Scene *before_;
    SceneParts parts_;
    MediaChanges media_;
    bool shapes_changed_ = false;
};

// An entry of a list without groups, relative to the scene's origin.
Dict Changes::placed(const char *key, const Dict &entry) const {
    if (!result_->origins) return entry;
    const bool is_sensor = std::string_view(key) == "sensor";
    const Dict moved =
        recentred({{key, is_sensor ? Value(entry) : Value(List{entry})}}, parts_, *result_->origins);
    const Value &value = *moved.find(key);
    return is_sensor ? *value.get_if<Dict>() : *value.get_if<List>()->front().get_if<Dict>();
}

bool Changes::change_looks(const EntryName &name, const Dict &entry, const std::string &where) {
    const auto &[list, index] = name;
    if (list == "textures") put(parts_.textures, index, read_texture(entry, index, where), where);
    else if (list == "bsdfs")
        put(parts_.bsdfs, index, read_bsdf(entry, parts_.textures.size(), where), where);
    else if (list == "adapters")
        put(parts_.adapters, index, read_adapter(entry, parts_, index, where), where);
    else if (list == "materials") put(parts_.materials, index, read_material(entry, parts_, where), where);
    else return false;
    return true;
}

void Changes::change_shape(std::size_t index, const Dict &entry, const std::string &where) {
    if (index >= parts_.shapes.size()) throw DescriptionError(where + ": there is no such entry");
    ShapeSlot slot = read_slot(entry, parts_, where);
    slot.emitter = parts_.slots[index].emitter;
    put(parts_.slots, index, slot, where);
    put(parts_.compositing, index, read_compositing(entry, where), where);
    if (!entry.contains("type")) return;
    Shape shape = read_shape(entry, where);
    check_size(shape, where);
    put(parts_.shapes, index, std::move(shape), where);
    shapes_changed_ = true;
}

bool Changes::change_places(const EntryName &name, const Dict &entry, const std::string &where) {
    const auto &[list, index] = name;
    if (list == "sensor") {
        parts_.camera = read_camera(placed("sensor", entry));
        parts_.camera_medium = read_camera_medium(entry, parts_);
    } else if (list == "emitters") {
        if (index >= parts_.lights.size()) throw DescriptionError(where + ": there is no such entry");
        auto [light, group] = read_light(placed("emitters", entry), parts_, where);
        put(parts_.lights, index, std::move(light), where);
        put(parts_.light_groups, index, group, where);
    } else if (list == "shapes") {
        change_shape(index, entry, where);
    } else if (list == "instances") {
        if (index >= parts_.instances.size()) throw DescriptionError(where + ": there is no such entry");
        put(parts_.instances, index, read_instance(entry, parts_.groups.size(), where), where);
        shapes_changed_ = true;
    } else if (list == "volumes") {
        media_.volumes.emplace(index, placed("volumes", entry));
    } else if (list == "phases") {
        media_.phases.emplace(index, entry);
    } else if (list == "media") {
        media_.media.emplace(index, entry);
    } else {
        return false;
    }
    return true;
}

bool Changes::change_output(const EntryName &name, const Dict &entry, const std::string &where) {
    if (name.list == "film") parts_.film = model_from<Film>(entry, where);
    else if (name.list == "rfilter") parts_.filter = variant_from<PixelFilter>(entry, where);
    else if (name.list == "integrator") result_->output.integrator = variant_from<Integrator>(entry, where);
    else if (name.list == "sampler") result_->set_sampler(variant_from<SamplerModel>(entry, where));
    else return false;
    return true;
}

void Changes::apply(const std::string &where, const Dict &entry) {
    const EntryName name = parsed(where);
    if (!change_looks(name, entry, where) && !change_places(name, entry, where) &&
        !change_output(name, entry, where))
        throw DescriptionError(where + ": there is no such entry");
}

// Whether a scene that is built anew would have another origin.
bool Changes::has_moved() { return shapes_changed_ && (result_->origins || Origins().move(parts_)); }

std::shared_ptr<RenderableScene> Changes::result() && {
    if (!media_.empty()) parts_.media = std::make_shared<const Media>(changed_media(*parts_.media, media_));
    if (has_moved()) return nullptr;
    if (shapes_changed_) check_scene_size(bounds_of(parts_));
    try {
        result_->scene = std::make_shared<const Scene>(std::move(parts_), before_);
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(error.what());
    }
    match_channels(*result_);
    return result_;
}

} // namespace

std::shared_ptr<RenderableScene> with_changes(const RenderableScene &scene, const Dict &changes) {
    Changes result(scene);
    for (const auto &[where, value] : changes) {
        const Dict *const entry = value.get_if<Dict>();
        if (!entry) throw UnexpectedValue(where, "a dict", value);
        result.apply(where, *entry);
    }
    return std::move(result).result();
}

} // namespace lajolla
