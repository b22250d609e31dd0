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

} // namespace

Media read_media(const Dict &description) {
    Media media;
    const auto add = [&](auto model, const std::string &where) {
        check_handles(model, media, where);
        try {
            media.add(std::move(model));
        } catch (const std::invalid_argument &error) {
            throw DescriptionError(where + ": " + error.what());
        }
    };
    for_each_entry(description, "volumes", [&](const Dict &entry, const std::string &where) {
        media.add(variant_from<VolumeModel>(entry, where));
    });
    for_each_entry(description, "phases", [&](const Dict &entry, const std::string &where) {
        add(variant_from<Phase>(entry, where), where);
    });
    for_each_entry(description, "media", [&](const Dict &entry, const std::string &where) {
        add(variant_from<Medium>(entry, where), where);
    });
    return media;
}

} // namespace lajolla
