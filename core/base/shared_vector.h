#pragma once
// Arrays that their copies share until one is edited: scenes that differ in a few objects share all others.

#include <atomic>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace lajolla {

template <class T>
class SharedVector {
public:
    SharedVector() = default;
    SharedVector(std::vector<T> items) : items_(std::make_shared<std::vector<T>>(std::move(items))) {}

    const T &operator[](std::size_t i) const { return (*items_)[i]; }
    const T *data() const { return items_->data(); }
    std::size_t size() const { return items_->size(); }
    bool empty() const { return items_->empty(); }
    auto begin() const { return std::as_const(*items_).begin(); }
    auto end() const { return std::as_const(*items_).end(); }

    // The array of this copy alone: elements move in memory if there are other copies.
    std::vector<T> &edit() {
        if (items_.use_count() > 1) items_ = std::make_shared<std::vector<T>>(*items_);
        else std::atomic_thread_fence(std::memory_order_acquire); // after the reads of copies that are gone
        return *items_;
    }
    // Whether this is a copy of the other, and neither was edited since.
    bool shares(const SharedVector &other) const { return items_ == other.items_; }

private:
    std::shared_ptr<std::vector<T>> items_ = std::make_shared<std::vector<T>>();
};

} // namespace lajolla
