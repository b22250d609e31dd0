#pragma once

#include "transport/path.h"

namespace lajolla {

struct VolPath : Path {
    static constexpr const char *name = "volpath";
    static constexpr const char *doc = "Path tracing through surfaces and media.";
    int version = 6;

    static constexpr auto fields() {
        return std::tuple_cat(
            Path::fields(),
            std::tuple(
                field("version", &VolPath::version,
                      "1 absorption only; 2 single scattering; 3 multiple scattering by phase function "
                      "sampling; 4 light sampling as well; 5 surfaces as well; 6 all media, the same as 5")
                    .range(1, 6)));
    }

    void build() {
        media_scatter = version > 1;
        surfaces_scatter = version > 4;
        const int longest = version == 1 ? 1 : version == 2 ? 2 : -1;
        if (longest > 0 && (max_depth < 0 || max_depth > longest)) max_depth = longest;
        if (version == 2) strategy = Strategy::light;
        if (version == 3) strategy = Strategy::bsdf;
    }

    Spectrum radiance(const Scene &scene, Tracer &tracer, const Sampler &sampler, PrimaryRay &primary,
                      const LightGroups &groups = {}) const {
        if (is_vacuum(scene)) return trace<Vacuum>(scene, tracer, sampler, primary, groups);
        return trace<InMedia>(scene, tracer, sampler, primary, groups);
    }
    // The media that a camera ray starts in.
    InMedia medium(const Scene &scene, const CameraRay<float> &camera, const Sampler &sampler) const {
        return InMedia(scene, camera, sampler, media_scatter);
    }
    bool is_vacuum(const Scene &scene) const { return scene.media().empty() && surfaces_scatter; }
};

} // namespace lajolla
