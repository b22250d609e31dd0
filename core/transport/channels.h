#pragma once
// The list of integrators, and the channels that they are recorded in.

#include <algorithm>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "transport/ao.h"
#include "transport/direct.h"
#include "transport/features.h"
#include "transport/first_hit.h"
#include "transport/path.h"
#include "transport/primary_ray.h"
#include "transport/volpath.h"

namespace lajolla {

using Integrator = std::variant<Path, VolPath, Direct, AmbientOcclusion, FirstHit, Features>;

// How textures are filtered in all channels of a picture.
inline FootprintKind footprint_of(const Integrator &picture) {
    return match(picture, [](const auto &model) {
        if constexpr (requires { model.footprint; }) return model.footprint;
        else return FootprintKind::differentials;
    });
}

// The value that a channel beside red, green and blue records for each sample.
enum class Recorded {
    rgb,
    xyz,
    alpha, // without the shadows on catchers, which follow from the next three
    catcher,
    shadowed,
    unshadowed,
    one
};
constexpr auto choices(Recorded) {
    return std::array{"rgb", "xyz", "alpha", "catcher", "shadowed", "unshadowed", "one"};
}

struct Channel {
    std::string label;
    int source = 0; // an integrator of the output; 0 is the one of the picture
    Recorded recorded = Recorded::rgb;
    int component = 0;
    bool squared = false; // square each sample: for second moments
    // The second moment is that of samples times filter weights, whose mean is the pixel. (The sum of samples
    // multiplies by the weight once more.)
    bool weighted = false;
    int light_group = -1; // light of one group of lights only; -1: of all

    static constexpr auto fields() {
        return std::tuple(
            field("label", &Channel::label, "its name in a file"),
            field("source", &Channel::source, "0 is the picture's integrator").range(0),
            field("recorded", &Channel::recorded,
                  "`catcher` is 1 where the camera sees a shadow catcher, `one` everywhere"),
            field("component", &Channel::component, "of rgb or xyz").range(0, 2),
            field("squared", &Channel::squared, "squares each sample, for second moments"),
            field("weighted", &Channel::weighted,
                  "with squared: of samples times filter weights, for the variance of the mean"),
            field("light_group", &Channel::light_group,
                  "of the picture: light of lights with this number as lightgroup; -1: of all lights")
                .range(-1));
    }
};

// The output of a render: the picture, whose red, green and blue are the first three channels, and other
// channels. All channels of a sample share its camera ray and its filter weight.
struct Output {
    Integrator integrator;          // renders the picture
    std::vector<Integrator> others; // for channels: source 1 and so on
    std::vector<Channel> channels;

    std::size_t channel_count() const { return 3 + channels.size(); }
    bool has_light_groups() const {
        return std::ranges::any_of(channels, [](const Channel &c) { return c.light_group >= 0; });
    }
};

// Computes the channels beside red, green and blue of one sample after the other.
class ChannelRecorder {
public:
    explicit ChannelRecorder(const Output &output)
        : output_(output), colours_(1 + output.others.size()), caught_(1 + output.others.size()),
          values_(output.channels.size()) {}

    // `picture` is the radiance that the picture's integrator has found along the camera ray, `weight` the
    // filter's, by which the caller multiplies the result. `groups` is the picture's radiance by light
    // groups, if there are any.
    std::span<const float> record(const Scene &scene, const Sampler &sampler, PrimaryRay &primary,
                                  const Spectrum &picture, std::span<const Spectrum> groups, float weight,
                                  Tracer &tracer);

private:
    const Integrator &integrator(const Channel &channel) const;
    float value_of(const Channel &channel, const Scene &scene, const Sampler &sampler, PrimaryRay &primary,
                   std::span<const Spectrum> groups, Tracer &tracer);
    float colour_value(const Channel &channel, std::span<const Spectrum> groups) const;

    const Output &output_;
    std::vector<Spectrum> colours_;                  // of every integrator
    std::vector<std::optional<CaughtLight>> caught_; // the same
    std::vector<float> values_;
};

} // namespace lajolla
