#pragma once
// Which objects the camera sees in each pixel, as whole numbers: for data sets, and for the mattes of
// compositors (Friedman and Jones 2015, "Fully automatic ID mattes with support for motion blur and
// transparency"). These are no means of samples, so they are computed beside the render: camera rays depend
// only on the seed and the sample index, and can be traced again.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "transport/render.h"

namespace lajolla {

// Kinds of objects that the description lists.
enum class ObjectKind { shape, material, instance };
constexpr auto choices(ObjectKind) { return std::array{"shape", "material", "instance"}; }

// The positions in the description's lists of what a ray hits; -1 for none.
struct ObjectIds {
    std::int32_t shape = -1, material = -1, instance = -1;
    std::int32_t primitive = -1; // of the shape

    std::int32_t operator[](ObjectKind kind) const {
        return kind == ObjectKind::shape ? shape : kind == ObjectKind::material ? material : instance;
    }
};

// Rows of the crop window.
struct RowRange {
    int first, end;
};

// What the ray through the centre of each pixel, and of the lens, sees, row by row. It passes straight
// through surfaces until half of the light is stopped.
std::vector<ObjectIds> ids_at_centres(const Scene &scene, const Integrator &picture, int threads);

// What object_coverage() counts: numbers above zero for the objects of a kind, by their position in the
// description's list. Objects with the same number count as one.
struct CountedObjects {
    ObjectKind kind;
    std::span<const std::int32_t> numbers;
};

// The objects that cover a pixel most, in this order: their numbers, and the fractions of the pixel's alpha
// that they make up. `ranks` of each per pixel, row by row; zero where there are no more.
struct RankedObjects {
    std::vector<std::int32_t> numbers;
    std::vector<float> coverage;
};

// Counts what the camera rays of samples see, as the picture's alpha does, but for media.
std::vector<RankedObjects> object_coverage(const Scene &scene, const Integrator &picture,
                                           std::span<const CountedObjects> counted, SequenceKind sequence,
                                           std::uint32_t seed, SampleRange samples, std::size_t ranks,
                                           RowRange rows, int threads);

} // namespace lajolla
