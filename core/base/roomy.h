#pragma once
// Arrays with padding after their last element.

#include <cstddef>
#include <memory>
#include <vector>

namespace lajolla {

// Wide code and the ray tracer read 16 bytes at each element, also at the last. Every copy is padded too, as
// it would not with reserve().
template <class T>
struct RoomyAllocator {
    using value_type = T;
    static constexpr std::size_t room = (16 + sizeof(T) - 1) / sizeof(T); // elements

    RoomyAllocator() = default;
    template <class U>
    RoomyAllocator(const RoomyAllocator<U> &) {}
    T *allocate(std::size_t n) { return std::allocator<T>().allocate(n + room); }
    void deallocate(T *p, std::size_t n) { std::allocator<T>().deallocate(p, n + room); }
    bool operator==(const RoomyAllocator &) const = default;
};

template <class T>
using RoomyVector = std::vector<T, RoomyAllocator<T>>;

} // namespace lajolla
