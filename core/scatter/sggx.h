#pragma once

#include <stdexcept>

#include "base/warp.h"
#include "scatter/phase.h"

namespace lajolla {

// Heitz, Dupuy, Crassin and Dachsbacher 2015, "The SGGX Microflake Distribution": mirrors with the
// distribution of normals of an ellipsoid.
struct Sggx {
    static constexpr const char *name = "sggx";
    static constexpr const char *doc = "Microflakes (SGGX): fibres and distant surfaces.";
    Volume<SymmetricMatrix> S{SymmetricMatrix{}};

    static constexpr auto fields() {
        return std::tuple(
            field("S", &Sggx::S,
                  "xx, yy, zz, xy, xz, yz of the positive definite matrix whose quadratic form is "
                  "the projected area squared; a volume has six channels"));
    }

    void build() const {
        if (S.is_constant() && !is_positive_definite(S.constant))
            throw std::invalid_argument("\"S\" must be a positive definite matrix");
    }

    struct Lobe {
        SymmetricMatrix S;

        // Equation 14
        float projected_area(Vec3f w) const { return safe_sqrt(dot(w, S * w)); }

        float eval(Vec3f wo, Vec3f wi) const {
            const Vec3f sum = wo + wi;
            return length_squared(sum) > 0 ? reflected(wo, normalize(sum)) : 0;
        }

        // Section 4.3 and the appendix: a visible normal, by the projection of the ellipsoid on a disk.
        PhaseSample sample(Vec3f wo, Vec2f u) const {
            const Frame<float> frame = frame_around(wo);
            const Vec3f s = S * frame.s, t = S * frame.t, n = S * frame.n;
            const float kk = dot(frame.s, s), jj = dot(frame.t, t), ii = dot(frame.n, n);
            const float kj = dot(frame.s, t), ki = dot(frame.s, n), ji = dot(frame.t, n);
            const float inverse_root = 1 / std::sqrt(ii);
            const float minor = safe_sqrt(jj * ii - ji * ji);
            const float det = safe_sqrt(SymmetricMatrix{kk, jj, ii, kj, ki, ji}.determinant());
            const Vec3f disk = sample_cosine_hemisphere(u);
            const Vec3f local{disk.x * det / minor - disk.y * inverse_root * (ki * ji - kj * ii) / minor +
                                  disk.z * inverse_root * ki,
                              disk.y * inverse_root * minor + disk.z * inverse_root * ji,
                              disk.z * inverse_root * ii};
            const Vec3f m = normalize(frame.to_world(local));
            return {normalize(reflect(wo, m)), reflected(wo, m)};
        }

    private:
        // Equations 15 and 17, for a mirror with the normal m: D(m) / (4 area(wo))
        float reflected(Vec3f wo, Vec3f m) const {
            const float det = S.determinant(), form = dot(m, S.adjugate() * m);
            return form > 0 ? det * safe_sqrt(det) / (pi * sqr(form)) / (4 * projected_area(wo)) : 0;
        }
    };

    Lobe prepare(const auto &read) const { return {regularised(read(S))}; }

    static constexpr float thinnest = 1e-6f; // determinant, relative to a sphere of the same trace

    // The largest increase of a projected area by regularised().
    static constexpr float most_growth = 1.3f;

    static bool is_positive_definite(const SymmetricMatrix &m) {
        const float third = m.trace() / 3;
        return m.xx > 0 && m.xx * m.yy - m.xy * m.xy > 0 &&
               m.determinant() > thinnest * third * third * third && std::isfinite(third * third * third) &&
               third * third * third > 0;
    }

    // Volumes may contain matrices that are not positive definite, between samples or outside. They are made
    // rounder, and zero becomes a tiny sphere.
    static SymmetricMatrix regularised(const SymmetricMatrix &m) {
        if (is_positive_definite(m)) return m;
        const float third = std::clamp(m.trace() / 3, 1e-8f, 1e8f);
        for (float part = 0.01f; part < 1; part *= 2) {
            SymmetricMatrix rounder = m;
            rounder.xx += part * third, rounder.yy += part * third, rounder.zz += part * third;
            if (is_positive_definite(rounder)) return rounder;
        }
        return {third, third, third};
    }
};

} // namespace lajolla
