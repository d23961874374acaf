#include "server/api/database_watch.h"

namespace kinevox {

std::shared_ptr<ProgressMailbox> DatabaseWatch::subscribe(std::function<void()> on_ready) {
    auto box = std::make_shared<ProgressMailbox>(MailboxOptions{}, std::move(on_ready));
    const std::scoped_lock lock(mutex_);
    box->put(newest_);
    if (!closed_.ok()) box->close(closed_);
    boxes_.push_back(box);
    return box;
}

void DatabaseWatch::publish(const DatabaseProgress& progress) {
    const std::scoped_lock lock(mutex_);   // held while putting, so that nobody gets the older word last
    newest_ = progress;
    std::erase_if(boxes_, [](const auto& box) { return box.expired(); });
    for (const auto& weak : boxes_)
        if (const auto box = weak.lock()) box->put(progress);
}

void DatabaseWatch::close(const absl::Status& why) {
    const std::scoped_lock lock(mutex_);
    closed_ = why;
    for (const auto& weak : boxes_)
        if (const auto box = weak.lock()) box->close(why);
}

}  // namespace kinevox
