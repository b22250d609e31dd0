#include "engine/media.h"

#include "engine/described.h"

namespace lajolla {

namespace {

template <class T>
void check_handle(const Volume<T> &volume, const Media &media, const std::string &where) {
    if (volume.id >= static_cast<std::int64_t>(media.volumes().size()))
        throw DescriptionError(where + ": there is no volume " + std::to_string(volume.id));
}
void check_handle(PhaseId phase, const Media &media, const std::string &where) {
    if (phase.id >= static_cast<std::int64_t>(media.phases().size()))
        throw DescriptionError(where + ": there is no phase function " + std::to_string(phase.id) +
                               " before this");
}

// Every volume and phase function that a model refers to must be there already.
template <class Variant>
void check_handles(const Variant &variant, const Media &media, const std::string &where) {
    match(variant, [&](const auto &model) {
        for_each_field<std::decay_t<decltype(model)>>([&](const auto &field) {
            if constexpr (requires { (model.*field.member).id; })
                check_handle(model.*field.member, media, where + "." + field.name);
        });
    });
}

// Adds a model that refers to earlier ones.
template <class Model>
void add(Media &media, Model model, const std::string &where) {
    if constexpr (!std::is_same_v<Model, VolumeModel>) check_handles(model, media, where);
    try {
        media.add(std::move(model));
    } catch (const std::invalid_argument &error) {
        throw DescriptionError(where + ": " + error.what());
    }
}

// The models of a list, with the changed ones in their places.
template <class Model>
void add_changed(Media &media, std::span<const Model> before, const std::map<std::size_t, Dict> &changes,
                 const std::string &list) {
    if (!changes.empty() && changes.rbegin()->first >= before.size())
        throw DescriptionError(list + "[" + std::to_string(changes.rbegin()->first) +
                               "]: there is no such entry");
    for (std::size_t i = 0; i < before.size(); ++i) {
        const auto changed = changes.find(i);
        const std::string where = list + "[" + std::to_string(i) + "]";
        add(media, changed == changes.end() ? before[i] : variant_from<Model>(changed->second, where), where);
    }
}

} // namespace

Media read_media(const Dict &description) {
    Media media;
    for_each_entry(description, "volumes", [&](const Dict &entry, const std::string &where) {
        add(media, variant_from<VolumeModel>(entry, where), where);
    });
    for_each_entry(description, "phases", [&](const Dict &entry, const std::string &where) {
        add(media, variant_from<Phase>(entry, where), where);
    });
    for_each_entry(description, "media", [&](const Dict &entry, const std::string &where) {
        add(media, variant_from<Medium>(entry, where), where);
    });
    return media;
}

Media changed_media(const Media &before, const MediaChanges &changes) {
    Media media;
    add_changed(media, before.volumes(), changes.volumes, "volumes");
    add_changed(media, before.phases(), changes.phases, "phases");
    add_changed(media, before.media(), changes.media, "media");
    return media;
}

} // namespace lajolla
