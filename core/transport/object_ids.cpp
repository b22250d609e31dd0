#include "transport/object_ids.h"

#include <algorithm>

#include "scene/faces.h"
#include "transport/coverage.h"
#include "transport/tiles.h"

namespace lajolla {

namespace {

bool hides_emitters(const Integrator &picture) {
    return match(picture, [](const auto &model) {
        if constexpr (requires { model.hide_emitters; }) return model.hide_emitters;
        else return false;
    });
}

ObjectIds ids_of(const Scene &scene, const RayHit &found) {
    ObjectIds ids;
    ids.shape = static_cast<std::int32_t>(found.shape);
    ids.material = scene.parts().slots[found.shape].material;
    if (found.instance != RayHit::no_instance) ids.instance = static_cast<std::int32_t>(found.instance);
    ids.primitive = face_of(scene, ids.shape, static_cast<std::int32_t>(found.primitive));
    return ids;
}

// Finds what camera rays see.
class Looker {
public:
    Looker(const Scene &scene, const Integrator &picture)
        : scene_(scene), tracer_(scene.accel()), hide_emitters_(hides_emitters(picture)),
          sees_through_(hide_emitters_ || scene.has_null_transmission() || scene.has_camera_roles()) {}

    const Scene &scene() const { return scene_; }
    Tracer &tracer() { return tracer_; }
    // `camera()` is the ray, which is needed where it may pass straight through what it found.
    template <class F>
    ObjectIds ids(std::optional<RayHit> found, F &&camera) {
        if (found && sees_through_) {
            const auto seen =
                look(scene_, tracer_, camera(), found, {hide_emitters_}, Vacuum(), scene_.needs()).object();
            found = seen ? std::optional(seen->found) : std::nullopt;
        }
        return found ? ids_of(scene_, *found) : ObjectIds{};
    }

private:
    const Scene &scene_;
    Tracer tracer_;
    bool hide_emitters_, sees_through_;
};

// The sums of filter weights of the objects of one kind in a pixel.
class Tally {
public:
    void add(std::int32_t number, float weight) {
        if (number <= 0) return;
        auto entry = std::ranges::find(entries_, number, &Entry::number);
        if (entry == entries_.end()) entry = entries_.insert(entry, {number, 0});
        entry->weight += weight;
    }
    // Writes the largest sums over `count`, in order, and starts anew.
    void take(std::uint32_t count, std::span<std::int32_t> numbers, std::span<float> coverage) {
        std::ranges::sort(entries_, [](const Entry &a, const Entry &b) {
            return a.weight > b.weight || (a.weight == b.weight && a.number < b.number);
        });
        for (std::size_t i = 0; i < std::min(entries_.size(), numbers.size()); ++i) {
            if (entries_[i].weight <= 0) break; // filters have negative weights
            numbers[i] = entries_[i].number;
            coverage[i] = static_cast<float>(entries_[i].weight / count);
        }
        entries_.clear();
    }

private:
    struct Entry {
        std::int32_t number;
        double weight;
    };
    std::vector<Entry> entries_;
};

// Counts the samples of one pixel after the other.
class PixelCounter {
public:
    PixelCounter(Looker &looker, std::span<const CountedObjects> counted)
        : looker_(looker), counted_(counted), tallies_(counted.size()) {}

    void count(SequenceKind sequence, std::uint32_t seed, std::uint32_t x, std::uint32_t y,
               SampleRange samples) {
        const Scene &scene = looker_.scene();
        std::array<Sampler, lanes> samplers;
        for (std::uint32_t first = samples.first; first < samples.end; first += lanes) {
            for (std::uint32_t k = 0; k < lanes; ++k) samplers[k] = Sampler(sequence, seed, x, y, first + k);
            const auto sampler = [&](int k) -> const Sampler & {
                return samplers[static_cast<std::size_t>(k)];
            };
            const auto film = sample_film(scene, Sampler::cameras(sampler), WideFloat(static_cast<float>(x)),
                                          WideFloat(static_cast<float>(y)));
            const WideBool active =
                first_lanes(static_cast<int>(std::min<std::uint32_t>(samples.end - first, lanes)));
            const RayHits hits = looker_.tracer().closest(film.camera.ray, active);
            for_each_lane(active, [&](int k) {
                const auto found = hits.shape[k] < 0 ? std::nullopt : std::optional(hits[k]);
                const auto camera = [&] {
                    return sample_film(scene, sampler(k).camera(), static_cast<float>(x),
                                       static_cast<float>(y))
                        .camera;
                };
                add(looker_.ids(found, camera), film.weight[k]);
            });
        }
    }
    Tally &tally(std::size_t kind) { return tallies_[kind]; }

private:
    void add(const ObjectIds &ids, float weight) {
        for (std::size_t i = 0; i < counted_.size(); ++i)
            if (const std::int32_t id = ids[counted_[i].kind]; id >= 0)
                tallies_[i].add(counted_[i].numbers[static_cast<std::size_t>(id)], weight);
    }

    Looker &looker_;
    std::span<const CountedObjects> counted_;
    std::vector<Tally> tallies_;
};

// Calls f(x, y) for the pixels of a tile.
template <class F>
void for_each_pixel(const Tile &tile, F &&f) {
    for (int y = tile.y0; y < tile.y1; ++y)
        for (int x = tile.x0; x < tile.x1; ++x) f(x, y);
}

} // namespace

std::vector<ObjectIds> ids_at_centres(const Scene &scene, const Integrator &picture, int threads) {
    const Film &film = scene.film();
    const auto width = static_cast<std::size_t>(film.crop_width);
    std::vector<ObjectIds> result(width * static_cast<std::size_t>(film.crop_height));
    const auto camera_at = [&](int x, int y) {
        const Vec2f centre{
            (static_cast<float>(x + film.crop_offset_x) + 0.5f) / static_cast<float>(film.width),
            (static_cast<float>(y + film.crop_offset_y) + 0.5f) / static_cast<float>(film.height)};
        CameraRay<float> camera = scene.camera_ray(centre, Vec2f{0.5f, 0.5f});
        camera.u_event = 0.5f; // one number decides about all surfaces: the median
        return camera;
    };
    for_each_tile(tiles_of(film), threads, [&](std::size_t, const Tile &tile) {
        Looker looker(scene, picture);
        for_each_pixel(tile, [&](int x, int y) {
            const CameraRay<float> camera = camera_at(x, y);
            result[static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x)] =
                looker.ids(looker.tracer().closest(camera.ray), [&] { return camera; });
        });
    });
    return result;
}

std::vector<RankedObjects> object_coverage(const Scene &scene, const Integrator &picture,
                                           std::span<const CountedObjects> counted, SequenceKind sequence,
                                           std::uint32_t seed, SampleRange samples, std::size_t ranks,
                                           RowRange rows, int threads) {
    const Film &film = scene.film();
    const auto width = static_cast<std::size_t>(film.crop_width);
    const std::size_t size = ranks * width * static_cast<std::size_t>(rows.end - rows.first);
    std::vector<RankedObjects> result(counted.size(),
                                      {std::vector<std::int32_t>(size), std::vector<float>(size)});
    const auto tiles = tiles_of(film, rows.first, rows.end);
    for_each_tile(tiles, threads, [&](std::size_t, const Tile &tile) {
        Looker looker(scene, picture);
        PixelCounter counter(looker, counted);
        for_each_pixel(tile, [&](int x, int y) {
            counter.count(sequence, seed, static_cast<std::uint32_t>(x + film.crop_offset_x),
                          static_cast<std::uint32_t>(y + film.crop_offset_y), samples);
            const std::size_t at =
                ranks * (static_cast<std::size_t>(y - rows.first) * width + static_cast<std::size_t>(x));
            for (std::size_t i = 0; i < counted.size(); ++i)
                counter.tally(i).take(samples.end - samples.first,
                                      std::span(result[i].numbers).subspan(at, ranks),
                                      std::span(result[i].coverage).subspan(at, ranks));
        });
    });
    return result;
}

} // namespace lajolla
