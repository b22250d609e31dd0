#include "images/face_images.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace lajolla {

namespace {

constexpr std::uint32_t most_faces_around = 256; // a vertex, whose texels are averaged

std::size_t bytes_of(TexelType type) { return type == TexelType::byte ? 1 : type == TexelType::half ? 2 : 4; }

std::uint8_t reduced_by(std::uint8_t log_size, int level) {
    return static_cast<std::uint8_t>(std::max(log_size - std::max(level, 0), 0));
}

std::size_t texel_count(const FaceImages::Face &face, int level) {
    return std::size_t{1} << (reduced_by(face.log_width, level) + reduced_by(face.log_height, level));
}

constexpr bool is_right(std::uint32_t corner) { return corner == 1 || corner == 2; }
constexpr bool is_upper(std::uint32_t corner) { return corner >= 2; }

} // namespace

// A picture of a face at one level of reduction.
struct FaceImages::View {
    std::uint32_t face;
    int level;
    std::uint8_t log_width, log_height;
    std::size_t first; // texel, or value of a reduced level

    std::uint32_t width() const { return 1u << log_width; }
    std::uint32_t height() const { return 1u << log_height; }
    std::uint32_t along(std::uint32_t edge) const { return edge % 2 == 0 ? width() : height(); }
    bool is_reduced() const { return level > 0; }
};

FaceImages::FaceImages(std::vector<Face> faces, std::uint32_t channels_, bool srgb_, TexelType type_,
                       std::vector<std::uint8_t> texels)
    : channels(channels_), srgb(srgb_), type(type_), faces_(std::move(faces)), texels_(std::move(texels)) {
    if (channels != 1 && channels != 3) throw std::invalid_argument("face images have 1 or 3 channels");
    std::size_t count = 0;
    for (const Face &face : faces_) {
        first_.push_back(count);
        if (face.log_width > most_log_size || face.log_height > most_log_size)
            throw std::invalid_argument("the picture of a face has more than 2^15 texels along an edge");
        count += face.is_constant ? 1 : texel_count(face, 0);
        for (std::size_t e = 0; e < 4; ++e)
            if (face.neighbours[e] >= static_cast<std::int64_t>(faces_.size()) || face.neighbours[e] < -1 ||
                face.edges[e] > 3)
                throw std::invalid_argument("a face has a neighbour that is not there");
    }
    if (texels_.size() != count * channels * bytes_of(type))
        throw std::invalid_argument("the number of texels does not fit the faces");
}

std::array<float, 2> FaceImages::bounds() const {
    if (type == TexelType::byte) return {0, 1};
    std::array<float, 2> result{infinity, -infinity};
    for (std::uint32_t f = 0; f < faces_.size(); ++f) {
        const View whole = view(f, 0);
        for (std::uint32_t y = 0; y < whole.height(); ++y)
            for (std::uint32_t x = 0; x < whole.width(); ++x) {
                const Spectrum value = texel(whole, x, y);
                for (std::size_t c = 0; c < channels; ++c) {
                    if (std::isnan(value[c])) return {-infinity, infinity};
                    result = {min(result[0], value[c]), max(result[1], value[c])};
                }
                if (faces_[f].is_constant) x = whole.width(), y = whole.height();
            }
    }
    return result;
}

// --- texels ----------------------------------------------------------------------------------------------

FaceImages::View FaceImages::view(std::uint32_t number, int level) const {
    const Face &face = faces_[number];
    level = std::min(level, static_cast<int>(std::max(face.log_width, face.log_height)));
    View result{number, level, reduced_by(face.log_width, level), reduced_by(face.log_height, level),
                first_[number]};
    if (level > 0 && !face.is_constant) {
        result.first = first_reduced_[number];
        for (int l = 1; l < level; ++l) result.first += texel_count(face, l) * channels;
    }
    return result;
}

Spectrum FaceImages::texel(const View &view, std::uint32_t x, std::uint32_t y) const {
    const bool is_constant = faces_[view.face].is_constant;
    const std::size_t index = is_constant ? 0 : (std::size_t{y} << view.log_width) + x;
    Spectrum result;
    if (view.is_reduced() && !is_constant) {
        const float *values = reduced_.data() + view.first + index * channels;
        for (std::size_t c = 0; c < 3; ++c) result[c] = values[channels == 3 ? c : 0];
        return result;
    }
    const std::uint8_t *bytes = texels_.data() + (view.first + index) * channels * bytes_of(type);
    for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t k = channels == 3 ? c : 0;
        if (type == TexelType::byte) {
            result[c] = linear_byte(bytes[k], srgb);
        } else if (type == TexelType::half) {
            Image::Half half;
            std::memcpy(&half, bytes + 2 * k, sizeof half);
            result[c] = static_cast<float>(half);
        } else {
            std::memcpy(&result[c], bytes + 4 * k, sizeof(float));
        }
    }
    return result;
}

void FaceImages::make_levels() const {
    std::call_once(levels_made_, [&] {
        for (std::uint32_t f = 0; f < faces_.size(); ++f) {
            const Face &face = faces_[f];
            first_reduced_.push_back(reduced_.size());
            const int levels = face.is_constant ? 0 : std::max(face.log_width, face.log_height);
            for (int level = 1; level <= levels; ++level) {
                const View from = view(f, level - 1), to = view(f, level);
                const std::uint32_t nx = from.width() / to.width(), ny = from.height() / to.height();
                for (std::uint32_t y = 0; y < to.height(); ++y)
                    for (std::uint32_t x = 0; x < to.width(); ++x) {
                        Spectrum sum{0};
                        for (std::uint32_t j = 0; j < ny; ++j)
                            for (std::uint32_t i = 0; i < nx; ++i) sum += texel(from, x * nx + i, y * ny + j);
                        for (std::size_t c = 0; c < channels; ++c)
                            reduced_.push_back(sum[c] / static_cast<float>(nx * ny));
                    }
            }
        }
    });
}

// --- lookups ---------------------------------------------------------------------------------------------

Spectrum FaceImages::nearest(std::uint32_t face, Vec2f place) const {
    const View whole = view(face, 0);
    const auto index = [](float x, std::uint32_t size) {
        return std::min(static_cast<std::uint32_t>(std::max(x, 0.0f) * static_cast<float>(size)), size - 1);
    };
    return texel(whole, index(place.x, whole.width()), index(place.y, whole.height()));
}

namespace {

// The texels on both sides of a coordinate, and the share of the second one.
struct Between {
    std::uint32_t first, second;
    float share;
};
Between between(float coordinate, std::uint32_t size) {
    const float x =
        std::clamp(coordinate * static_cast<float>(size) - 0.5f, 0.0f, static_cast<float>(size - 1));
    const auto first = static_cast<std::uint32_t>(x);
    return {first, std::min(first + 1, size - 1), x - static_cast<float>(first)};
}

} // namespace

// Of this face alone.
Spectrum FaceImages::interpolated(const View &view, Vec2f place) const {
    const Between x = between(place.x, view.width()), y = between(place.y, view.height());
    const auto row = [&](std::uint32_t j) {
        return lerp(x.share, texel(view, x.first, j), texel(view, x.second, j));
    };
    return lerp(y.share, row(y.first), row(y.second));
}

Spectrum FaceImages::corner_texel(const View &view, std::uint32_t corner) const {
    return texel(view, is_right(corner) ? view.width() - 1 : 0, is_upper(corner) ? view.height() - 1 : 0);
}

// The texels along an edge of this face, interpolated.
Spectrum FaceImages::border(const View &view, std::uint32_t edge, float along) const {
    const Between k = between(along, view.along(edge));
    const auto at = [&](std::uint32_t i) {
        const std::uint32_t right = view.width() - 1, top = view.height() - 1;
        switch (edge) {
        case 0: return texel(view, i, 0);
        case 1: return texel(view, right, i);
        case 2: return texel(view, right - i, top);
        default: return texel(view, 0, top - i);
        }
    };
    return lerp(k.share, at(k.first), at(k.second));
}

// Goes to the neighbour across an edge, and to its edge. False where there is none, or where it is not as
// long.
bool FaceImages::cross(View &from, std::uint32_t &edge) const {
    const Face &face = faces_[from.face];
    const std::int32_t other = face.neighbours[edge];
    if (other < 0) return false;
    const auto number = static_cast<std::uint32_t>(other);
    const Face &neighbour = faces_[number];
    if (neighbour.is_part != face.is_part) return false;
    const auto log_along = [](const Face &f, std::uint32_t e) {
        return e % 2 == 0 ? f.log_width : f.log_height;
    };
    const std::uint32_t its_edge = face.edges[edge];
    from = view(number, from.level + log_along(neighbour, its_edge) - log_along(face, edge));
    edge = its_edge;
    return true;
}

// The mean of the texels at a vertex, of all faces around it.
Spectrum FaceImages::at_vertex(const View &from, std::uint32_t corner) const {
    Spectrum sum = corner_texel(from, corner);
    float count = 1;
    // Edges that start at the vertex lead around it one way, those that end there the other way.
    for (const std::uint32_t other_way : {0u, 1u}) {
        View here = from;
        std::uint32_t edge = (corner + 3 * other_way) % 4;
        while (count < most_faces_around && cross(here, edge)) {
            const std::uint32_t at = other_way ? edge : (edge + 1) % 4; // the corner at the vertex
            if (here.face == from.face && at == corner) return sum * (1 / count);
            sum += corner_texel(here, at);
            ++count;
            edge = other_way ? (edge + 3) % 4 : at;
        }
    }
    return sum * (1 / count);
}

// The value on an edge: the mean of the faces on both sides, which near a vertex becomes that of all faces
// there. It is the same seen from both faces.
struct FaceImages::OnEdge {
    Spectrum of_both, value;
};

FaceImages::OnEdge FaceImages::on_edge(const View &view, std::uint32_t edge, float along) const {
    Spectrum mean = border(view, edge, along);
    std::uint32_t texels = view.along(edge);
    View other = view;
    std::uint32_t its_edge = edge;
    if (cross(other, its_edge)) {
        mean = (mean + border(other, its_edge, 1 - along)) * 0.5f;
        texels = std::max(texels, other.along(its_edge));
    }
    const bool at_end = along > 0.5f;
    const float share = 1 - (at_end ? 1 - along : along) * 2 * static_cast<float>(texels);
    if (!(share > 0)) return {mean, mean};
    return {mean, lerp(share, mean, at_vertex(view, at_end ? (edge + 1) % 4 : edge))};
}

// Within half a texel of the edges, differences to the values on the edges are blended in, as Coons patches
// blend their borders. Where four faces with equal pictures meet, this is bilinear interpolation over all of
// them.
Spectrum FaceImages::smooth(std::uint32_t face, Vec2f place, int level) const {
    const View here = view(face, level);
    const Vec2f p{std::clamp(place.x, 0.0f, 1.0f), std::clamp(place.y, 0.0f, 1.0f)};
    const Spectrum alone = interpolated(here, p);
    const bool right = p.x > 0.5f, top = p.y > 0.5f;
    const float from_side = 1 - (right ? 1 - p.x : p.x) * 2 * static_cast<float>(here.width());
    const float from_end = 1 - (top ? 1 - p.y : p.y) * 2 * static_cast<float>(here.height());
    const std::uint32_t side = right ? 1 : 3, end = top ? 2 : 0;
    const float along_side = right ? p.y : 1 - p.y, along_end = top ? 1 - p.x : p.x;
    OnEdge at_side, at_end;
    Spectrum value = alone;
    if (from_side > 0) {
        at_side = on_edge(here, side, along_side);
        value += (at_side.value - border(here, side, along_side)) * from_side;
    }
    if (from_end > 0) {
        at_end = on_edge(here, end, along_end);
        value += (at_end.value - border(here, end, along_end)) * from_end;
    }
    if (!(from_side > 0 && from_end > 0)) return value;
    const std::uint32_t corner = top ? (right ? 2 : 3) : (right ? 1 : 0);
    const Spectrum at_corner = at_vertex(here, corner);
    value += (corner_texel(here, corner) - at_corner) * (from_side * from_end);
    // Between pictures of different sizes, the sum could leave the range of its parts.
    const Spectrum low = min(min(alone, at_corner), min(at_side.of_both, at_end.of_both));
    const Spectrum high = max(max(alone, at_corner), max(at_side.of_both, at_end.of_both));
    return max(low, min(value, high));
}

} // namespace lajolla
