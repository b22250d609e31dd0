#include "transport/channels.h"

#include <algorithm>
#include <limits>

#include "transport/shadow_catcher.h"

namespace lajolla {

namespace {

// Linear sRGB to CIE XYZ (IEC 61966-2-1).
Spectrum to_xyz(Spectrum c) {
    return {0.412453f * c.x + 0.357580f * c.y + 0.180423f * c.z, luminance(c),
            0.019334f * c.x + 0.119193f * c.y + 0.950227f * c.z};
}

// The alpha of what an integrator shows: those that show surfaces instead of light look through nothing.
float alpha(const Scene &scene, const Integrator &integrator, const Sampler &sampler, PrimaryRay &primary,
            Tracer &tracer) {
    return match(integrator, [&](const auto &model) {
        if constexpr (requires { model.medium(scene, primary.camera(), sampler); })
            if (!scene.media().empty())
                return coverage(scene, tracer, primary, model.hide_emitters,
                                model.medium(scene, primary.camera(), sampler));
        if constexpr (requires { model.hide_emitters; })
            return coverage(scene, tracer, primary, model.hide_emitters, Vacuum());
        if (!scene.has_camera_roles()) return primary.found() ? 1.0f : 0.0f;
        return seen_object(scene, tracer, primary, first_surface) ? 1.0f : 0.0f;
    });
}

CaughtLight caught_light(const Scene &scene, const Integrator &integrator, const Sampler &sampler,
                         PrimaryRay &primary, Tracer &tracer) {
    return match(integrator, [&](const auto &model) {
        if constexpr (requires { model.medium(scene, primary.camera(), sampler); })
            if (!scene.media().empty())
                return caught_light(scene, tracer, sampler, primary, model.hide_emitters,
                                    model.medium(scene, primary.camera(), sampler));
        if constexpr (requires { model.caught_light(scene, tracer, sampler, primary); })
            return model.caught_light(scene, tracer, sampler, primary);
        else if constexpr (requires { model.hide_emitters; })
            return caught_light(scene, tracer, sampler, primary, model.hide_emitters, Vacuum());
        else return CaughtLight{};
    });
}

} // namespace

std::span<const float> ChannelRecorder::record(const Scene &scene, const Sampler &sampler,
                                               PrimaryRay &primary, const Spectrum &picture,
                                               std::span<const Spectrum> groups, float weight,
                                               Tracer &tracer) {
    colours_[0] = picture;
    for (std::size_t i = 0; i < output_.others.size(); ++i)
        colours_[i + 1] = match(output_.others[i], [&](const auto &model) {
            return model.radiance(scene, tracer, sampler, primary);
        });
    std::ranges::fill(caught_, std::nullopt);
    for (std::size_t i = 0; i < values_.size(); ++i) {
        const Channel &channel = output_.channels[i];
        const float value = value_of(channel, scene, sampler, primary, groups, tracer);
        // A square that a float cannot hold must not make the sample count as black.
        const float square = std::min(sqr(value), std::numeric_limits<float>::max() / 16);
        values_[i] = !channel.squared ? value : square * (channel.weighted ? weight : 1);
    }
    return values_;
}

float ChannelRecorder::value_of(const Channel &channel, const Scene &scene, const Sampler &sampler,
                                PrimaryRay &primary, std::span<const Spectrum> groups, Tracer &tracer) {
    const auto caught = [&]() -> const CaughtLight & {
        auto &known = caught_[static_cast<std::size_t>(channel.source)];
        if (!known) known = caught_light(scene, integrator(channel), sampler, primary, tracer);
        return *known;
    };
    switch (channel.recorded) {
    case Recorded::alpha: return alpha(scene, integrator(channel), sampler, primary, tracer);
    case Recorded::catcher: return caught().seen ? 1.0f : 0.0f;
    case Recorded::shadowed: return caught().shadowed;
    case Recorded::unshadowed: return caught().unshadowed;
    default: return colour_value(channel, groups);
    }
}

const Integrator &ChannelRecorder::integrator(const Channel &channel) const {
    return channel.source == 0 ? output_.integrator
                               : output_.others[static_cast<std::size_t>(channel.source) - 1];
}

float ChannelRecorder::colour_value(const Channel &channel, std::span<const Spectrum> groups) const {
    if (channel.recorded == Recorded::one) return 1;
    const Spectrum rgb = channel.light_group < 0 ? colours_[static_cast<std::size_t>(channel.source)]
                                                 : groups[static_cast<std::size_t>(channel.light_group)];
    const Spectrum c = channel.recorded == Recorded::xyz ? to_xyz(rgb) : rgb;
    return channel.component == 0 ? c.x : channel.component == 1 ? c.y : c.z;
}

} // namespace lajolla
