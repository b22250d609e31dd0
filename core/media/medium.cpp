#include "media/medium.h"

#include <stdexcept>

namespace lajolla {

namespace {

std::uint32_t channels(const VolumeModel &volume) {
    return match(volume, [](const auto &v) { return v.grid->channels; });
}

template <class T>
void check_channels(const Volume<T> &volume, std::span<const VolumeModel> volumes, const char *name) {
    constexpr bool matrix = std::is_same_v<T, SymmetricMatrix>;
    if (!volume.is_constant() && (channels(volumes[static_cast<std::size_t>(volume.id)]) == 6) != matrix)
        throw std::invalid_argument(std::string("\"") + name + "\" needs a volume of " +
                                    (matrix ? "six channels" : "one channel or three"));
}

// Every volume that a model reads must have the right number of channels.
template <class Variant>
void check_volumes(const Variant &variant, std::span<const VolumeModel> volumes) {
    match(variant, [&](const auto &model) {
        for_each_field<std::decay_t<decltype(model)>>([&](const auto &field) {
            if constexpr (requires { (model.*field.member).is_constant(); })
                check_channels(model.*field.member, volumes, field.name);
        });
    });
}

} // namespace

// An upper bound of projected areas.
float Media::largest_area(PhaseId phase) const {
    if (phase.id < 0) return 1;
    return match(phases_[static_cast<std::size_t>(phase.id)], [&](const auto &model) {
        using Model = std::decay_t<decltype(model)>;
        if constexpr (std::is_same_v<Model, BlendPhase>)
            return std::max(largest_area(model.phase_0), largest_area(model.phase_1));
        else if constexpr (std::is_same_v<Model, Sggx>) {
            if (model.S.is_constant()) return std::sqrt(model.S.constant.trace());
            const float most = match(volumes_[static_cast<std::size_t>(model.S.id)],
                                     [](const auto &v) { return largest_row_sum(*v.grid); });
            return Sggx::most_growth * std::sqrt(std::max(most, 1e-8f));
        } else return 1.0f;
    });
}

bool Media::reads_volumes(PhaseId phase) const {
    if (phase.id < 0) return false;
    return match(phases_[static_cast<std::size_t>(phase.id)], [&](const auto &model) {
        using Model = std::decay_t<decltype(model)>;
        if constexpr (std::is_same_v<Model, BlendPhase>)
            return !model.weight.is_constant() || reads_volumes(model.phase_0) ||
                   reads_volumes(model.phase_1);
        else if constexpr (std::is_same_v<Model, Sggx>) return !model.S.is_constant();
        else return false;
    });
}

void Media::add(Phase phase) {
    check_volumes(phase, volumes_);
    phases_.push_back(std::move(phase));
    check_phase(phases_, {static_cast<std::int32_t>(phases_.size()) - 1});
}

void Media::add(Medium medium) {
    check_volumes(medium, volumes_);
    const PhaseId phase = match(medium, [](const auto &m) { return m.phase; });
    const bool directional = has_directions(phases_, phase);
    if (auto *varying = std::get_if<Heterogeneous>(&medium)) {
        const float scale = varying->scale * largest_area(phase);
        varying->majorants = varying->sigma_t.is_constant()
                                 ? MajorantGrid(scale * max_component(varying->sigma_t.constant))
                                 : match(volumes_[static_cast<std::size_t>(varying->sigma_t.id)],
                                         [&](const auto &volume) { return MajorantGrid(volume, scale); });
    } else if (directional && reads_volumes(phase))
        throw std::invalid_argument("a homogeneous medium cannot have particles that differ from place to "
                                    "place: their area is part of the extinction");
    const float densest = match(medium, [&](const auto &m) {
        if constexpr (requires { m.majorants; }) return m.majorants.maximum();
        else
            return is_finite(m.sigma_a * m.emission)
                       ? max_component(m.sigma_a + m.sigma_s) * largest_area(phase)
                       : infinity;
    });
    if (!std::isfinite(densest))
        throw std::invalid_argument("the medium is too dense: its extinction overflows");
    densest_.push_back(densest);
    media_.push_back(std::move(medium));
    directional_.push_back(directional);
}

Coefficients Media::coefficients(std::int32_t medium, const Vec3f &position, const Vec3f &wo) const {
    const VolumeReader read(volumes_, position);
    Coefficients c = match((*this)[medium], [&](const auto &model) { return model.coefficients(read); });
    if (directional_[static_cast<std::size_t>(medium)]) {
        const float area = phase(medium, position).projected_area(wo);
        c.sigma_a *= area, c.sigma_s *= area, c.emission *= area;
    }
    return c;
}

PhaseLobe Media::phase(std::int32_t medium, const Vec3f &position) const {
    const PhaseId id = match((*this)[medium], [](const auto &model) { return model.phase; });
    return prepare(phases_, id, VolumeReader(volumes_, position));
}

std::size_t Media::bytes() const {
    std::size_t sum = 0;
    for (const VolumeModel &volume : volumes_)
        sum += match(volume, [](const auto &v) { return v.grid->bytes(); });
    for (const Medium &medium : media_)
        if (const auto *varying = std::get_if<Heterogeneous>(&medium)) sum += varying->majorants.bytes();
    return sum;
}

} // namespace lajolla
