// The streams that some browser wants, one of each, and a thread for each. Everything but the threads' own
// work happens on the gateway's thread.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "client/web/daemon_streams.h"
#include "client/web/wants.h"

namespace kinevox::web {

class Feeds {
  public:
    struct Options {
        std::function<void(std::function<void()>)> post;  // any thread; runs its argument on the gateway's
        // These come on the gateway's thread. `lost`: messages replaced by this one before that thread had
        // time.
        std::function<void(const Topic&, std::shared_ptr<const std::string> body, std::uint64_t lost)>
            on_message;
        std::function<void(const Topic&, const absl::Status& why)>
            on_end;                                             // by itself: it will not begin again
        std::function<void(const absl::Status& link)> on_link;  // when it changes
    };

    Feeds(DaemonStreams& daemon, Options options);
    ~Feeds();  // waits for the threads, which end at once

    // Begins and ends streams so that exactly these run.
    void want(const std::set<Topic>& topics);

  private:
    struct Feed;
    void begin(const Topic& topic);
    void ended(std::uint64_t id, const absl::Status& why);

    DaemonStreams& daemon_;
    Options options_;
    std::uint64_t next_id_ = 1;
    std::map<std::uint64_t, std::unique_ptr<Feed>> feeds_;  // those told to end, too, until they have
};

}  // namespace kinevox::web
