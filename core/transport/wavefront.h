#pragma once
// Many paths at a time (Laine et al. 2013, "Megakernels Considered Harmful: Wavefront Path Tracing on GPUs"):
// the functions of transport/path.h for one vertex of hundreds of paths. A step traces all rays in packets,
// sorts the hits by material, and scatters paths of the same material in SIMD lanes, which then share the
// model and its parameters. Shadow rays are collected and traced in packets too.
//
// A path's random numbers do not depend on other paths, so the result equals that of single paths, bit for
// bit.

#include <span>
#include <vector>

#include "transport/path.h"
#include "transport/primary_ray.h"

namespace lajolla {

class Wavefront {
public:
    static constexpr std::size_t capacity = 512;      // paths at a time
    static constexpr std::size_t most_samples = 4096; // of a call of render()

    Wavefront(const Scene &scene, const Path &integrator);

    // The radiance and the filter weights of samples, at most `most_samples`. `groups` gets the radiance of
    // each sample by light groups, side by side, unless it is empty.
    void render(std::span<const SampleId> ids, SequenceKind sequence, std::uint32_t seed, Tracer &tracer,
                std::span<Spectrum> radiance, std::span<float> weights, std::span<Spectrum> groups = {});

private:
    // A path between two steps, in rows of four numbers that lanes load and store as columns; and the
    // differentials of its ray.
    struct alignas(16) StoredPath {
        float rows[6][4];
    };
    struct alignas(16) StoredDifferentials {
        float rows[3][4];
    };
    struct alignas(16) StoredHit {
        float distance, b1, b2;
        std::int32_t primitive;
    };
    struct alignas(16) StoredShadowRay {
        float origin[3], far, direction[3];
        std::int32_t sample;
        float value[3];     // its contribution if it is not occluded
        std::int32_t light; // for light groups
    };
    // Paths that hit the same material.
    struct Group {
        std::int32_t material; // or one of the two below
        std::uint32_t first, count;
    };
    static constexpr std::int32_t missed = -2, one_by_one = -3;

    // The steps.
    void start(std::span<const SampleId> ids, std::size_t first, std::size_t count, std::span<float> weights);
    void trace(Tracer &tracer);
    bool needs_care(std::size_t path) const;
    void sort();
    void scatter(const Group &group, Tracer &tracer);
    void trace_shadow_rays(Tracer &tracer);

    // Groups.
    void gather_environment(std::span<const std::int32_t> paths);
    void gather_emission(std::span<const std::int32_t> paths);
    void follow_one_by_one(std::span<const std::int32_t> paths, Tracer &tracer);
    // The hits that a BSDF scatters: all of them, or those on one side.
    enum class Sides { front, both, front_only, back_only };
    template <class Model>
    void scatter(const Model &model, const BsdfTraits &traits, Sides sides, bool softened,
                 std::span<const std::int32_t> paths, Tracer &tracer);
    // The same for a material that is a tree: blends, masks and maps around BSDFs.
    void scatter_tree(const Material &material, std::span<const std::int32_t> paths, Tracer &tracer);

    struct Vertex;
    // What to do at a vertex: sample lights, or the next direction, or both.
    enum class Task { sample_light, sample_direction, both };
    template <class Model>
    void scatter_at(const Vertex &vertex, const Model &model, const BsdfTraits &traits,
                    const MappedNormal<WideFloat> &normal, WideBool turned, WideBool active, WideFloat share,
                    Task task, Tracer &tracer);
    void scatter_at(const Vertex &vertex, std::int32_t bsdf, const MappedNormal<WideFloat> &normal,
                    WideBool turned, WideBool active, WideFloat share, Task task, Tracer &tracer);

    // The paths in the lanes, and their samples.
    struct Packet {
        alignas(64) std::int32_t paths[lanes], samples[lanes];
        WideBool active;
    };
    // The vertex at which the path in each lane is scattered.
    struct Vertex {
        const Packet &packet;
        const PathState<WideFloat> &path;
        const Hit<WideFloat> &hit;
        Vec3<WideFloat> wo;
        BounceSample<WideFloat> u;
    };
    template <class F>
    void for_each_packet(std::span<const std::int32_t> paths, F &&f) const;
    PathState<WideFloat> load(const Packet &packet) const;
    std::optional<RayDifferentials<WideFloat>> load_differentials(const Packet &packet,
                                                                  WideBool followed) const;
    RayHits load_hits(const Packet &packet) const;
    std::int32_t sample_of(std::int32_t path) const;
    void append(const PathState<WideFloat> &path, const Packet &packet, WideBool active);
    void store_differentials(const RayDifferentials<WideFloat> &differentials, std::size_t first,
                             unsigned kept);
    void append(const Ray<WideFloat> &ray, const Rgb<WideFloat> &value, WideInt light, const Packet &packet,
                WideBool active);
    // Adds light of the lights `light()` from a direction, towards the lights.
    template <class F>
    void add(const Rgb<WideFloat> &value, const Packet &packet, WideBool active,
             const Vec3<WideFloat> &direction, F &&light);
    // Where the light of a sample goes by groups.
    LightGroups light_groups(std::int32_t sample) const;
    PathState<float> one(std::size_t path) const;
    void append(const PathState<float> &path, std::int32_t sample);

    void add_emission(const PathState<WideFloat> &path, const Hit<WideFloat> &hit, const Packet &packet);
    void add_direct_light(const Vertex &vertex, const DirectSample<WideFloat> &light,
                          const BsdfEval<WideFloat> &bsdf, const Vec3<WideFloat> &origin, WideFloat share,
                          WideBool lit, Tracer &tracer);
    template <class LobeType>
    void sample_light(const Vertex &vertex, const Surface<WideFloat, LobeType> &surface, WideFloat share,
                      WideBool active, Tracer &tracer);
    BounceSample<WideFloat> numbers(const Packet &packet, const PathState<WideFloat> &path) const;

    const Scene &scene_;
    const Path &integrator_;
    std::size_t light_group_count_;
    std::vector<std::int32_t> group_of_shape_; // its material, or one_by_one
    std::vector<bool> transmits_;              // whether light may pass straight through a shape
    std::vector<std::uint32_t> group_sizes_;   // by material, zero between steps

    std::vector<Sampler> samplers_; // of the current samples
    std::span<Spectrum> radiance_;
    std::span<Spectrum> group_light_; // by light groups, of all samples; empty if there are none

    std::size_t count_ = 0, next_count_ = 0, shadow_count_ = 0;
    std::vector<StoredPath> paths_, next_;
    std::vector<StoredDifferentials> differentials_, next_differentials_; // empty if none are followed
    std::vector<StoredHit> hits_;
    std::vector<std::int32_t> shapes_, instances_; // of the hits
    std::vector<StoredShadowRay> shadow_rays_;
    std::vector<Group> groups_;
    std::vector<std::int32_t> order_; // paths, group by group
    std::vector<std::int32_t> group_of_path_;
};

} // namespace lajolla
