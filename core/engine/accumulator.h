#pragma once
// A progressive render: adds samples to running sums, from which a picture can be computed at any time.

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

namespace lajolla {

struct RenderableScene;
struct Progress;

class Accumulator {
public:
    // The scene must outlive this. Default of the seed: that of the scene.
    explicit Accumulator(const RenderableScene &scene, std::optional<std::uint32_t> seed = std::nullopt);
    ~Accumulator();

    // Adds samples first ... first + count - 1 of every pixel. Returns false, and changes nothing, where
    // cancel() was called meanwhile. threads = 0 uses them all; one_lane follows one path after the other,
    // for the same bits. All of these may be called from several threads.
    bool add(std::uint32_t first, std::uint32_t count, int threads = 0, bool one_lane = false);
    void cancel();
    double progress() const; // finished fraction of the running add()

    std::size_t width() const, height() const, channels() const;
    std::vector<float> image() const; // means, row by row, the channels of a pixel side by side
    std::uint64_t samples() const { return locked(samples_); } // per pixel
    std::uint64_t rays() const { return locked(rays_); }
    std::uint64_t nonfinite() const { return locked(nonfinite_); }  // samples that count as black
    auto nonfinite_list() const { return locked(nonfinite_list_); } // (x, y, sample) of the first of them

private:
    std::size_t pixels() const { return width() * height(); }

    template <class T>
    T locked(const T &value) const {
        const std::lock_guard lock(results_);
        return value;
    }

    const RenderableScene &scene_;
    std::unique_ptr<Progress> progress_;
    std::mutex adding_;
    mutable std::mutex results_; // of everything below
    std::uint32_t seed_;
    std::vector<double> sums_;
    std::uint64_t samples_ = 0, rays_ = 0, nonfinite_ = 0;
    std::vector<std::tuple<std::uint32_t, std::uint32_t, std::uint32_t>> nonfinite_list_;
};

} // namespace lajolla
