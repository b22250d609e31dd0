#pragma once
// The list of media, and the properties of a medium at a point.

#include <variant>
#include <vector>

#include "media/majorants.h"
#include "media/volumes.h"
#include "scatter/phases.h"

namespace lajolla {

// The properties of a medium per unit of length.
struct Coefficients {
    Spectrum sigma_a{0}, sigma_s{0}; // absorption and scattering
    Spectrum emission{0};            // radiance added

    Spectrum sigma_t() const { return sigma_a + sigma_s; }
};

struct Homogeneous {
    static constexpr const char *name = "homogeneous";
    static constexpr const char *doc = "A homogeneous medium.";
    Spectrum sigma_a{0.25f}, sigma_s{0.75f}, emission{0};
    PhaseId phase;

    static constexpr auto fields() {
        return std::tuple(field("sigma_a", &Homogeneous::sigma_a, "absorption").range(0).unit("1/length"),
                          field("sigma_s", &Homogeneous::sigma_s, "scattering").range(0).unit("1/length"),
                          field("emission", &Homogeneous::emission,
                                "radiance of an opaque medium: emission * sigma_a is added per length")
                              .range(0),
                          field("phase", &Homogeneous::phase, "phase function"));
    }

    // Whether collisions are sampled. A medium that does not scatter needs none: absorption has a closed
    // form.
    bool collides(bool scatters) const { return scatters && !is_black(sigma_s); }
    Coefficients coefficients(const auto &) const { return {sigma_a, sigma_s, sigma_a * emission}; }
};

struct Heterogeneous {
    static constexpr const char *name = "heterogeneous";
    static constexpr const char *doc = "A heterogeneous medium; it ends where the volume of sigma_t ends.";
    Volume<Spectrum> sigma_t{Spectrum(1)}, albedo{Spectrum(0.75f)}, emission{Spectrum(0)};
    float scale = 1;
    PhaseId phase;
    MajorantGrid majorants; // of sigma_t's largest channel; made by Media::add

    static constexpr auto fields() {
        return std::tuple(
            field("sigma_t", &Heterogeneous::sigma_t, "extinction").range(0).unit("1/length"),
            field("albedo", &Heterogeneous::albedo, "fraction of the extinction that is scattering")
                .range(0, 1),
            field("emission", &Heterogeneous::emission,
                  "radiance of an opaque medium: emission * absorption is added per length")
                .range(0),
            field("scale", &Heterogeneous::scale, "multiplies the extinction").range(0),
            field("phase", &Heterogeneous::phase, "phase function"));
    }

    bool collides(bool) const { return true; }
    Coefficients coefficients(const auto &read) const {
        const Spectrum extinction = max(read.inside(sigma_t) * scale, Spectrum(0));
        const Spectrum scattering = extinction * clamp(read(albedo), Spectrum(0), Spectrum(1));
        const Spectrum absorption = extinction - scattering;
        return {absorption, scattering, absorption * max(read(emission), Spectrum(0))};
    }
};

using Medium = std::variant<Homogeneous, Heterogeneous>;

// The media of a scene, with the models that they refer to. Added models may refer to earlier ones by valid
// ids.
class Media {
public:
    void add(VolumeModel volume) { volumes_.push_back(std::move(volume)); }
    // These throw std::invalid_argument if parameters contradict each other.
    void add(Phase phase);
    void add(Medium medium);

    bool empty() const { return media_.empty(); }
    std::size_t size() const { return media_.size(); }
    std::span<const VolumeModel> volumes() const { return volumes_; }
    std::span<const Phase> phases() const { return phases_; }
    std::span<const Medium> media() const { return media_; }
    const Medium &operator[](std::int32_t medium) const { return media_[static_cast<std::size_t>(medium)]; }

    // The coefficients of a medium at a point for light along wo, in either direction.
    Coefficients coefficients(std::int32_t medium, const Vec3f &position, const Vec3f &wo) const;
    PhaseLobe phase(std::int32_t medium, const Vec3f &position) const;
    // Whether an error of positions is not small compared with the medium's mean free path.
    bool is_dense(std::int32_t medium, float position_error) const {
        return densest_[static_cast<std::size_t>(medium)] * position_error > 1e-3f;
    }

    std::size_t bytes() const;

private:
    float largest_area(PhaseId phase) const;
    bool reads_volumes(PhaseId phase) const;

    std::vector<VolumeModel> volumes_;
    std::vector<Phase> phases_;
    std::vector<Medium> media_;
    std::vector<bool> directional_; // whether a medium's extinction depends on the direction
    std::vector<float> densest_;    // an upper bound of the extinction
};

} // namespace lajolla
