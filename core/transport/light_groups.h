#pragma once
// The light of a sample, by groups of lights. Most renders have no groups: then nothing is collected, and the
// cost is one comparison for a contribution, or for those of all lanes.

#include <span>

#include "scene/scene.h"

namespace lajolla {

class LightGroups {
public:
    LightGroups() = default;
    // Adds to `sums`, one for each group of the scene.
    LightGroups(const Scene &scene, std::span<Spectrum> sums)
        : scene_(sums.empty() ? nullptr : &scene), sums_(sums) {}

    explicit operator bool() const { return scene_ != nullptr; }
    // Adds light from a light, -1 for the emission of media, that arrives from a direction: towards the
    // light.
    void add(std::int32_t light, const Vec3f &direction, const Spectrum &value,
             bool from_camera = false) const {
        if (!scene_) return;
        const Spectrum seen = factor_ * value;
        const auto add_share = [&](std::int32_t one, const Spectrum &share) {
            sums_[static_cast<std::size_t>(scene_->light_group(one))] += share * seen;
        };
        scene_->lights().for_each_share(light, direction, from_camera, add_share);
    }
    // Adds light of a sample of a light that was selected with this random number.
    void add_picked(float u_pick, const Vec3f &direction, const Spectrum &value) const {
        if (scene_) add(scene_->lights().picked(u_pick), direction, value);
    }
    // The same, for light that is multiplied by a factor before it reaches the camera.
    LightGroups times(const Spectrum &factor) const {
        LightGroups result = *this;
        if (scene_) result.factor_ *= factor;
        return result;
    }

private:
    const Scene *scene_ = nullptr;
    std::span<Spectrum> sums_;
    Spectrum factor_{1};
};

} // namespace lajolla
