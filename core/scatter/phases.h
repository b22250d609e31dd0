#pragma once
// The list of phase functions. To add one: write its file, include it here and add its name to the list. The
// reader, the documentation and the statistical tests follow.

#include <array>
#include <span>
#include <stdexcept>

#include "base/match.h"
#include "scatter/blendphase.h"
#include "scatter/hg.h"
#include "scatter/isotropic.h"
#include "scatter/phase.h"
#include "scatter/rayleigh.h"
#include "scatter/sggx.h"
#include "scatter/tabphase.h"

namespace lajolla {

using Phase = std::variant<Isotropic, HenyeyGreenstein, Rayleigh, TabulatedPhase, Sggx, BlendPhase>;

// A phase function at a point: a mixture of a few lobes, usually of one. Its value is the weighted sum, and
// samples select a lobe with probability equal to its weight.
class PhaseLobe {
public:
    static constexpr std::size_t most_parts = 4;

    PhaseLobe() { add(1, Isotropic::Lobe{}); }

    float eval(const Vec3f &wo, const Vec3f &wi) const {
        if (size_ == 1) return eval(0, wo, wi);
        const Shares shares = shares_of(wo);
        float sum = 0;
        for (std::size_t i = 0; i < size_; ++i) sum += shares[i] * eval(i, wo, wi);
        return sum;
    }

    PhaseSample sample(const Vec3f &wo, float u_lobe, const Vec2f &u) const {
        if (size_ == 1) return sample(0, wo, u);
        const Shares shares = shares_of(wo);
        std::size_t chosen = 0;
        for (std::size_t i = 0; i < size_; ++i) { // rounding errors select the last part
            if (!(shares[i] > 0)) continue;
            chosen = i;
            if (u_lobe < shares[i]) break;
            u_lobe -= shares[i];
        }
        auto [wi, pdf] = sample(chosen, wo, u);
        pdf *= shares[chosen];
        for (std::size_t i = 0; i < size_; ++i)
            if (i != chosen && shares[i] > 0) pdf += shares[i] * eval(i, wo, wi);
        return {wi, pdf};
    }

    // Multiplies the extinction; see phase.h.
    float projected_area(const Vec3f &wo) const {
        float sum = 0;
        for (std::size_t i = 0; i < size_; ++i) sum += parts_[i].weight * area(i, wo);
        return sum;
    }

private:
    using Simple = std::variant<Isotropic::Lobe, HenyeyGreenstein::Lobe, Rayleigh::Lobe, TabulatedPhase::Lobe,
                                Sggx::Lobe>;
    static_assert(IsPhaseLobe<Isotropic::Lobe> && IsPhaseLobe<HenyeyGreenstein::Lobe> &&
                  IsPhaseLobe<Rayleigh::Lobe> && IsPhaseLobe<TabulatedPhase::Lobe> &&
                  IsPhaseLobe<Sggx::Lobe>);
    struct Part {
        float weight = 0;
        Simple lobe;
    };
    using Shares = std::array<float, most_parts>;

    explicit PhaseLobe(std::size_t size) : size_(size) {}
    void add(float weight, const Simple &lobe) { parts_[size_++] = {weight, lobe}; }

    float eval(std::size_t i, const Vec3f &wo, const Vec3f &wi) const {
        return match(parts_[i].lobe, [&](const auto &l) { return l.eval(wo, wi); });
    }
    PhaseSample sample(std::size_t i, const Vec3f &wo, const Vec2f &u) const {
        return match(parts_[i].lobe, [&](const auto &l) { return l.sample(wo, u); });
    }
    float area(std::size_t i, const Vec3f &wo) const {
        return match(parts_[i].lobe, [&](const auto &l) { return l.projected_area(wo); });
    }
    // The fraction of the scattered light of each part: proportional to its weight and projected area.
    Shares shares_of(const Vec3f &wo) const {
        Shares shares{};
        float sum = 0;
        for (std::size_t i = 0; i < size_; ++i) sum += shares[i] = parts_[i].weight * area(i, wo);
        for (std::size_t i = 0; i < size_; ++i) shares[i] /= sum;
        return shares;
    }

    template <class Read>
    friend void add_parts(std::span<const Phase>, PhaseId, float, const Read &, PhaseLobe &);
    template <class Read>
    friend PhaseLobe prepare(std::span<const Phase>, PhaseId, const Read &);

    std::array<Part, most_parts> parts_;
    std::size_t size_ = 0;
};

template <class Read>
void add_parts(std::span<const Phase> phases, PhaseId phase, float weight, const Read &read,
               PhaseLobe &lobe) {
    if (phase.id < 0) return lobe.add(weight, Isotropic::Lobe{});
    match(phases[static_cast<std::size_t>(phase.id)], [&](const auto &model) {
        if constexpr (std::is_same_v<std::decay_t<decltype(model)>, BlendPhase>) {
            const float second = std::clamp(read(model.weight), 0.0f, 1.0f);
            add_parts(phases, model.phase_0, weight * (1 - second), read, lobe);
            add_parts(phases, model.phase_1, weight * second, read, lobe);
        } else lobe.add(weight, model.prepare(read));
    });
}

// The phase function with this id, evaluated by `read`.
template <class Read>
PhaseLobe prepare(std::span<const Phase> phases, PhaseId phase, const Read &read) {
    PhaseLobe lobe(0);
    add_parts(phases, phase, 1, read, lobe);
    return lobe;
}

// The number of parts of a phase function. Throws std::invalid_argument if a blend refers to a phase function
// that does not precede it, or has too many parts.
inline std::size_t check_phase(std::span<const Phase> phases, PhaseId phase) {
    if (phase.id < 0) return 1;
    const auto *blend = std::get_if<BlendPhase>(&phases[static_cast<std::size_t>(phase.id)]);
    if (!blend) return 1;
    if (blend->phase_0.id >= phase.id || blend->phase_1.id >= phase.id)
        throw std::invalid_argument("a blendphase must stand after the phase functions that it mixes");
    const std::size_t parts = check_phase(phases, blend->phase_0) + check_phase(phases, blend->phase_1);
    if (parts > PhaseLobe::most_parts)
        throw std::invalid_argument("a blendphase mixes more than four phase functions");
    return parts;
}

// Whether the medium's extinction depends on the direction.
inline bool has_directions(std::span<const Phase> phases, PhaseId phase) {
    if (phase.id < 0) return false;
    const Phase &model = phases[static_cast<std::size_t>(phase.id)];
    if (const auto *blend = std::get_if<BlendPhase>(&model))
        return has_directions(phases, blend->phase_0) || has_directions(phases, blend->phase_1);
    return std::holds_alternative<Sggx>(model);
}

} // namespace lajolla
