#pragma once
// A picture for each face of a mesh of quads, as Ptex has them (Burley and Lacewell 2008, "Ptex: Per-Face
// Texture Mapping for Production Rendering").

#include <array>
#include <cstdint>
#include <mutex>
#include <vector>

#include "images/image.h"

namespace lajolla {

// Places on a face are (s, t) in the unit square. Its corners 0 to 3 are (0, 0), (1, 0), (1, 1) and (0, 1);
// its edge e runs from the corner e to the next one.
class FaceImages {
public:
    struct Face {
        std::uint8_t log_width, log_height;     // the picture has 2^log_width x 2^log_height texels
        bool is_constant;                       // one texel stands for all
        bool is_part;                           // of a face that is no quad, at one of its corners
        std::array<std::int32_t, 4> neighbours; // across each edge; -1 for none
        std::array<std::uint8_t, 4> edges;      // of the neighbours, which are the same as these
    };
    static constexpr unsigned most_log_size = 15;

    // `texels` has the texels of one face after the other, row by row from t = 0, with 1 or 3 values each.
    // Throws std::invalid_argument where that does not fit, or a face has a neighbour that is not there.
    FaceImages(std::vector<Face> faces, std::uint32_t channels, bool srgb, TexelType type,
               std::vector<std::uint8_t> texels);

    std::uint32_t channels;
    bool srgb; // 8-bit values are sRGB encoded
    TexelType type;
    const std::vector<Face> &faces() const { return faces_; }
    const std::vector<std::uint8_t> &texels() const { return texels_; } // their bytes

    // The least and the largest value that any texel may have; both infinite where one is not a number.
    std::array<float, 2> bounds() const;
    // Makes the coarser levels that smooth() reads where `level` is above zero.
    void make_levels() const;

    Spectrum nearest(std::uint32_t face, Vec2f place) const;
    // Interpolated between the centres of texels, also those of neighbouring faces: it is continuous over the
    // whole mesh. Texels are those of a face's picture reduced by 2^level; neighbours have texels of the same
    // size as far as they can. A negative level means that neighbours with finer pictures are not reduced as
    // much.
    Spectrum smooth(std::uint32_t face, Vec2f place, int level) const;

private:
    struct View;
    View view(std::uint32_t face, int level) const;
    Spectrum texel(const View &view, std::uint32_t x, std::uint32_t y) const;
    Spectrum interpolated(const View &view, Vec2f place) const;
    Spectrum corner_texel(const View &view, std::uint32_t corner) const;
    Spectrum border(const View &view, std::uint32_t edge, float along) const;
    struct OnEdge;
    OnEdge on_edge(const View &view, std::uint32_t edge, float along) const;
    Spectrum at_vertex(const View &view, std::uint32_t corner) const;
    bool cross(View &view, std::uint32_t &edge) const;

    std::vector<Face> faces_;
    std::vector<std::size_t> first_; // texel of each face
    std::vector<std::uint8_t> texels_;
    mutable std::vector<std::size_t> first_reduced_; // value of each face's level 1
    mutable std::vector<float> reduced_;             // linear values of all levels from 1 on
    mutable std::once_flag levels_made_;
};

} // namespace lajolla
