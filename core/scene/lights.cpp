#include "scene/lights.h"

#include <stdexcept>

namespace lajolla {

namespace {

constexpr float degrees = pi / 180;

// Uniform in the cone under which a sphere is seen from outside it (Shirley, Wang and Zimmerman 1996). The
// cone's height 1 - cos is computed from the sine, because a far sphere's cosine rounds to one.
struct SphereCone {
    Vec3f axis;
    float distance, height;
};

std::optional<SphereCone> cone_towards(const Sphere &sphere, const Vec3f &p) {
    const Vec3f to_center = sphere.center - p;
    const float squared = length_squared(to_center), sin_squared = sqr(sphere.radius) / squared;
    if (sin_squared >= 1 - 1e-5f) return std::nullopt; // inside, or so near that the cone is a half space
    const float distance = std::sqrt(squared);
    return SphereCone{to_center / distance, distance, sin_squared / (1 + std::sqrt(1 - sin_squared))};
}

SurfaceSample sample_cone_of(const Sphere &sphere, const SphereCone &cone, Vec2f u) {
    const Vec3f local = sample_cone(u, cone.height);
    // The triangle of the viewer, the sphere's centre and the near intersection, whose angle at the viewer is
    // theta: `along` from the viewer by the roots' product, which does not cancel near the surface, then the
    // angle alpha at the centre by the law of sines.
    const float r = sphere.radius, d = cone.distance, cos_theta = local.z;
    const float sin_theta_squared = sqr(local.x) + sqr(local.y);
    const float along = (d - r) * (d + r) / (d * cos_theta + safe_sqrt(sqr(r) - sqr(d) * sin_theta_squared));
    const float sin_ratio = along / r, cos_alpha = (d - along * cos_theta) / r;
    const Frame frame = frame_around(-cone.axis);
    return sphere.at(normalize(frame.to_world({sin_ratio * local.x, sin_ratio * local.y, cos_alpha})));
}

DirectSample towards(const Vec3f &p, const SurfaceSample &point) {
    const Vec3f to_light = point.position - p;
    const float distance = length(to_light);
    const Vec3f wi = to_light / distance;
    const Vec3f target =
        point.position - point.normal * std::copysign(point.position_error, dot(point.normal, wi));
    return {wi, distance, target, Spectrum(0), 0};
}

// What lights are picked by: half of the time by power, else evenly, for power knows nothing of distance, and
// a lamp at a wall must not be left out because there are brighter ones elsewhere. The power of lights at
// infinity is what enters the whole scene; little of it may be where the camera looks, and they count for no
// more than all others.
std::vector<float> pick_weights(std::span<const Light> lights, std::span<const float> powers) {
    const auto is_distant = [](const auto &light) {
        using T = std::decay_t<decltype(light)>;
        return IsEnvironment<T> || std::is_same_v<T, DirectionalLight>;
    };
    double distant = 0, local = 0, shining = 0;
    for (std::size_t i = 0; i < lights.size(); ++i) {
        (match(lights[i], is_distant) ? distant : local) += powers[i];
        shining += powers[i] > 0;
    }
    const double factor = local > 0 ? std::min(local / distant, 1.0) : 1;
    const double even = shining > 0 ? (local + factor * distant) / shining : 0;
    std::vector<float> weights;
    for (std::size_t i = 0; i < lights.size(); ++i) {
        const double power = powers[i] * (match(lights[i], is_distant) ? factor : 1);
        weights.push_back(power > 0 ? static_cast<float>(power + even) : 0.0f);
    }
    return weights;
}

} // namespace

// Area

// Textured rectangles are sampled by what a table holds of their luminance; it need not be exact, but must
// not vanish where the texture does not.
void AreaLight::prepare_sampling(std::span<const TextureModel> textures) {
    const auto *rectangle = std::get_if<Rectangle>(shape);
    if (!rectangle || radiance.is_constant()) return;
    const auto *bitmap = std::get_if<Bitmap>(&textures[static_cast<std::size_t>(radiance.id)]);
    constexpr std::uint32_t finest = 512;
    const std::uint32_t width = std::min(bitmap ? bitmap->image->width : finest, finest),
                        height = std::min(bitmap ? bitmap->image->height : finest, finest);
    constexpr int probes = 2; // along each side of a cell
    std::vector<float> weights(static_cast<std::size_t>(width) * height);
    double sum = 0;
    for (std::uint32_t y = 0; y < height * probes; ++y)
        for (std::uint32_t x = 0; x < width * probes; ++x) {
            const Vec2f u{(static_cast<float>(x) + 0.5f) / static_cast<float>(width * probes),
                          (static_cast<float>(y) + 0.5f) / static_cast<float>(height * probes)};
            const float value = luminance(radiance_at(rectangle->sample(0, u), textures));
            weights[static_cast<std::size_t>(y / probes) * width + x / probes] += std::max(value, 0.0f);
            sum += value;
        }
    constexpr float uniform_share = 0.1f;
    const auto least = uniform_share * static_cast<float>(sum / static_cast<double>(weights.size()));
    for (float &weight : weights) weight += least;
    if (sum > 0) table_ = Distribution2D(weights, width, height);
}

float AreaLight::power(std::span<const TextureModel> textures, const BoundingSphere &) const {
    const float area = match(*shape, [](const auto &s) { return s.area(); });
    return pi * area * (radiance.is_constant() ? luminance(radiance.constant) : mean_luminance(textures));
}

float AreaLight::mean_luminance(std::span<const TextureModel> textures) const {
    constexpr int grid = 32; // of points: power only steers the picking
    float sum = 0;
    for (int j = 0; j < grid; ++j)
        for (int i = 0; i < grid; ++i) {
            const Vec2f u{(static_cast<float>(i) + 0.5f) / grid, (static_cast<float>(j) + 0.5f) / grid};
            const float which = (static_cast<float>((j * 13 + i * 7) % grid) + 0.5f) / grid;
            const SurfaceSample point = match(*shape, [&](const auto &s) { return s.sample(which, u); });
            sum += luminance(radiance_at(point, textures));
        }
    return sum / (grid * grid);
}

DirectSample AreaLight::sample_direct(const Vec3f &p, float u_primitive, Vec2f u,
                                      std::span<const TextureModel> textures) const {
    const auto *sphere = std::get_if<Sphere>(shape);
    const auto cone = sphere ? cone_towards(*sphere, p) : std::nullopt;
    float density = 1; // over the rectangle's own coordinates
    if (!table_.empty()) {
        const auto chosen = table_.sample(u);
        u = chosen.position;
        density = chosen.pdf;
    }
    const SurfaceSample point = cone ? sample_cone_of(*sphere, *cone, u)
                                     : match(*shape, [&](const auto &s) { return s.sample(u_primitive, u); });
    DirectSample sample = towards(p, point);
    const float cosine = -dot(sample.wi, point.normal);
    if (!(cosine > 0)) return {}; // seen from behind
    sample.pdf = cone ? cone_pdf(cone->height) : density * point.area_pdf * sqr(sample.distance) / cosine;
    sample.radiance = radiance.is_constant() ? radiance.constant : radiance_at(point, textures);
    return sample;
}

Spectrum AreaLight::radiance_at(const SurfaceSample &point, std::span<const TextureModel> textures) const {
    // As a ray sees it that comes straight from the front.
    const float distance = std::max(point.position_error, 1e-20f);
    const RayHit found{distance, point.b1, point.b2, 0, point.primitive};
    Hit hit;
    hit.primitive = point.primitive;
    match(*shape, [&](const auto &s) {
        s.fill({point.position + point.normal * distance, -point.normal}, found, hit);
    });
    return TextureReader(textures, {hit.uv, &hit, shape})(radiance);
}

float AreaLight::pdf_hit(const Vec3f &p, const Hit &hit, const Vec3f &wi) const {
    if (const auto *sphere = std::get_if<Sphere>(shape))
        if (const auto cone = cone_towards(*sphere, p)) return cone_pdf(cone->height);
    const float cosine = std::abs(dot(wi, hit.normal));
    const float area = match(*shape, [](const auto &s) { return s.area(); });
    const float density = table_.empty() ? 1 : table_.pdf(hit.uv);
    return cosine > 0 ? density * length_squared(hit.position - p) / (area * cosine) : 0;
}

// Environment map

// The image's first and last rows lie on the poles, as in Mitsuba 3; columns are centred in their share of
// the turn.

void EnvironmentMap::build() {
    if (!image || image->width == 0 || image->height == 0)
        throw std::invalid_argument("an envmap needs an image");
    const auto inverted = inverse(to_world);
    if (!inverted || !uniform_scale(to_world))
        throw std::invalid_argument(
            "to_world of an envmap must be a rotation, without shear or uneven scaling");
    to_local_ = *inverted;
    // A cell has texel centres at its corners: its bilinear values vanish only where its weight does.
    const std::uint32_t width = image->width, rows = std::max(image->height, 2u) - 1;
    std::vector<float> weights(static_cast<std::size_t>(width) * rows);
    double sum = 0;
    for (std::uint32_t y = 0; y < rows; ++y) {
        const float low = pi * static_cast<float>(y) / static_cast<float>(rows);
        const float high = pi * static_cast<float>(y + 1) / static_cast<float>(rows);
        const float band = std::cos(low) - std::cos(high); // solid angle of the row over 2 pi
        const std::uint32_t below = std::min(y + 1, image->height - 1);
        for (std::uint32_t x = 0; x < width; ++x) {
            const std::uint32_t right = (x + 1) % width;
            const Spectrum corners = image->texel(x, y) + image->texel(right, y) + image->texel(x, below) +
                                     image->texel(right, below);
            const float weight = std::max(luminance(corners) / 4, 0.0f) * band;
            weights[static_cast<std::size_t>(y) * width + x] = weight;
            sum += weight;
        }
    }
    mean_radiance_ = static_cast<float>(sum / (2.0 * width));
    distribution_ = Distribution2D(weights, width, rows);
}

float EnvironmentMap::power(std::span<const TextureModel>, const BoundingSphere &scene) const {
    return 4 * pi * pi * sqr(scene.radius) * scale * mean_radiance_;
}

// The square is (phi / 2 pi, theta / pi), phi counted from the centre of the first column.
Vec2f EnvironmentMap::to_square(const Vec3f &direction) const {
    const Vec3f d = to_local_.vector(direction);
    const float turn = std::atan2(d.x, -d.z) * (0.5f * inv_pi) - 0.5f / static_cast<float>(image->width);
    return {turn - std::floor(turn), std::atan2(std::sqrt(d.x * d.x + d.z * d.z), d.y) * inv_pi};
}

Spectrum EnvironmentMap::look_up(Vec2f square) const {
    const Vec2f size{static_cast<float>(image->width), static_cast<float>(image->height - 1)};
    return bilinear(*image, square * size + Vec2f{0.5f, 0.5f}, WrapMode::repeat, WrapMode::clamp) * scale;
}

Spectrum EnvironmentMap::emitted(const Vec3f &direction) const { return look_up(to_square(direction)); }

DirectSample EnvironmentMap::sample_direct(const Vec3f &, float, Vec2f u,
                                           std::span<const TextureModel>) const {
    const auto [square, density] = distribution_.sample(u);
    const float theta = pi * square.y, sin_theta = std::sin(theta);
    const float phi = 2 * pi * (square.x + 0.5f / static_cast<float>(image->width));
    if (!(sin_theta > 0) || !(density > 0)) return {};
    const Vec3f local{std::sin(phi) * sin_theta, std::cos(theta), -std::cos(phi) * sin_theta};
    const float pdf = density / (2 * pi * pi * sin_theta);
    return DirectSample{normalize(to_world.vector(local)), infinity, {}, look_up(square), pdf};
}

float EnvironmentMap::pdf_direction(const Vec3f &wi) const {
    const Vec2f square = to_square(wi);
    const float sin_theta = std::sin(pi * square.y);
    return sin_theta > 0 ? distribution_.pdf(square) / (2 * pi * pi * sin_theta) : 0;
}

// Disk

void DistantDisk::build() {
    if (!(length(direction) > 0)) throw std::invalid_argument("direction of a distant disk has no length");
    direction = normalize(direction);
    axes_ = frame_around(-direction);
    const float half = angle * degrees / 2;
    height_ = 2 * sqr(std::sin(half / 2));
    radiance_ = irradiance / (pi * sqr(std::sin(half))); // the integral of the cosine over the disk
}

DirectSample DistantDisk::sample_direct(const Vec3f &, float, Vec2f u, std::span<const TextureModel>) const {
    const Vec3f wi = normalize(axes_.to_world(sample_cone(u, height_)));
    return DirectSample{wi, infinity, {}, radiance_, cone_pdf(height_)};
}

// Picking

LightPicker::LightPicker(std::span<const Light> lights, std::span<const TextureModel> textures,
                         const BoundingSphere &scene)
    : lights_(lights), textures_(textures) {
    std::vector<float> powers;
    for (std::uint32_t i = 0; i < lights.size(); ++i)
        match(lights[i], [&](const auto &light) {
            powers.push_back(light.power(textures, scene));
            has_delta_lights_ |= IsDeltaLight<std::decay_t<decltype(light)>>;
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) environments_.push_back(i);
        });
    // A light whose power overflows must not hide the others.
    float strongest = 0;
    for (const float power : powers)
        if (std::isfinite(power)) strongest = std::max(strongest, power);
    for (float &power : powers)
        if (!std::isfinite(power)) power = strongest > 0 ? strongest : 1;
    picks_ = Distribution(pick_weights(lights, powers));
}

DirectSample LightPicker::sample_direct(const Vec3f &p, float u_pick, Vec2f u) const {
    const auto pick = picks_.sample(u_pick);
    // A light that is picked rarely leaves few of u_pick's 24 bits to choose a triangle with: low bits of u
    // fill in.
    const float low_bits = u.x * 4096 - std::floor(u.x * 4096);
    const float u_primitive = std::min(pick.rest + low_bits * (0x1p-24f / pick.probability), one_minus_ulp);
    DirectSample sample = match(lights_[pick.index], [&](const auto &light) {
        return light.sample_direct(p, u_primitive, u, textures_);
    });
    if (sample.delta) sample.radiance *= 1 / pick.probability;
    else sample.pdf *= pick.probability;
    if (environments_.size() > 1 && sample.pdf > 0 && !sample.delta && sample.distance == infinity) {
        // Lights around the scene are one light, sampled by the mixture of their densities.
        sample.radiance = environment(sample.wi);
        sample.pdf = pdf_environment(sample.wi);
    }
    return sample;
}

float LightPicker::pdf_hit(const Vec3f &p, const Hit &hit, const Vec3f &wi) const {
    if (empty()) return 0;
    const auto &light = std::get<AreaLight>(lights_[static_cast<std::size_t>(hit.emitter)]);
    return picks_.probability(static_cast<std::uint32_t>(hit.emitter)) * light.pdf_hit(p, hit, wi);
}

float LightPicker::pdf_environment(const Vec3f &wi) const {
    if (empty()) return 0;
    float sum = 0;
    for (const std::uint32_t index : environments_)
        sum += picks_.probability(index) * match(lights_[index], [&](const auto &light) {
                   if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) return light.pdf_direction(wi);
                   else return 0.0f;
               });
    return sum;
}

Spectrum LightPicker::emitted(const Hit &hit, const Vec3f &wo) const {
    return hit.emitter < 0 ? Spectrum(0)
                           : std::get<AreaLight>(lights_[static_cast<std::size_t>(hit.emitter)])
                                 .emitted(hit, wo, textures_);
}

Spectrum LightPicker::environment(const Vec3f &direction) const {
    Spectrum sum(0);
    for (const std::uint32_t index : environments_)
        sum += match(lights_[index], [&](const auto &light) {
            if constexpr (IsEnvironment<std::decay_t<decltype(light)>>) return light.emitted(direction);
            else return Spectrum(0);
        });
    return sum;
}

} // namespace lajolla
