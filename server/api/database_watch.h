// Who follows the building of the pose database.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include <absl/status/status.h>

#include "server/pipeline/mailbox.h"
#include "server/pose/database/database_service.h"

namespace kinevox {

using ProgressMailbox = Mailbox<DatabaseProgress>;

// Any thread. A subscription lasts as long as the caller keeps the mailbox, which holds the newest word only.
class DatabaseWatch {
  public:
    // Starts with what was published last.
    std::shared_ptr<ProgressMailbox> subscribe(std::function<void()> on_ready);
    void publish(const DatabaseProgress& progress);
    // Closes every mailbox, and whichever is subscribed to later. `why` is what the streams end with.
    void close(const absl::Status& why);

  private:
    std::mutex mutex_;
    std::vector<std::weak_ptr<ProgressMailbox>> boxes_;
    DatabaseProgress newest_;
    absl::Status closed_;
};

}  // namespace kinevox
