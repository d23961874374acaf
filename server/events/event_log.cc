#include "server/events/event_log.h"

#include <algorithm>
#include <utility>

#include "common/utc_clock.h"

namespace kinevox {

std::shared_ptr<EventMailbox> EventLog::subscribe(std::size_t history_count, std::function<void()> on_ready) {
    auto box =
        std::make_shared<EventMailbox>(MailboxOptions{.max_messages = kMaxQueued}, std::move(on_ready));
    const std::scoped_lock lock(mutex_);
    const std::size_t count = std::min(history_count, history_.size());
    for (std::size_t i = history_.size() - count; i < history_.size(); ++i) box->put(history_[i]);
    if (!closed_.ok()) box->close(closed_);
    mailboxes_.push_back(box);
    return box;
}

void EventLog::publish(Event event, std::int64_t time_utc_ns, std::uint32_t subject_id) {
    const std::uint32_t concerned = event.subject_id ? event.subject_id : subject_id;
    PublishedEvent published{0, time_utc_ns, concerned, std::move(event)};
    const std::scoped_lock lock(mutex_);  // held while posting, so that all see the same order
    published.id = ++count_;
    history_.push_back(published);
    if (history_.size() > kMaxHistory) history_.pop_front();
    for (const auto& box : alive()) box->put(published);
}

void EventLog::publish(Event event) {
    publish(std::move(event), utc_now_ns());
}

void EventLog::publish(EventKind kind, std::string message, std::uint64_t sequence) {
    publish(Event{kind, sequence, 0, {}, std::move(message)}, utc_now_ns());
}

void EventLog::close(const absl::Status& why) {
    std::vector<std::shared_ptr<EventMailbox>> boxes;
    {
        const std::scoped_lock lock(mutex_);
        closed_ = why;
        boxes = alive();
    }
    for (const auto& box : boxes) box->close(why);
}

int EventLog::subscriber_count() const {
    const std::scoped_lock lock(mutex_);
    return static_cast<int>(
        std::ranges::count_if(mailboxes_, [](const auto& weak) { return !weak.expired(); }));
}

std::vector<std::shared_ptr<EventMailbox>> EventLog::alive() {
    std::vector<std::shared_ptr<EventMailbox>> found;
    std::erase_if(mailboxes_, [&](const std::weak_ptr<EventMailbox>& weak) {
        std::shared_ptr<EventMailbox> box = weak.lock();
        if (!box) return true;
        found.push_back(std::move(box));
        return false;
    });
    return found;
}

}  // namespace kinevox
