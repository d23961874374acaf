// The daemon's parts around a fake capture, below a folder of their own, served on a free port of this
// machine.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "tests/fuzz/api_script.h"

namespace grpc {
class Channel;
}

namespace kinevox::fuzz {

class FuzzedDaemon {
  public:
    FuzzedDaemon();
    ~FuzzedDaemon();

    // Who holds nothing, or two tokens, sends none of these.
    const std::string& token(Who who) const;
    // Whether the table of calls and roles lets them call it; kExpired, kWrongToken and kNobody never.
    bool may(Who who, const std::string& path) const;

    std::shared_ptr<grpc::Channel> channel() const;
    void give(int frame_sets);
    const std::filesystem::path& root()
        const;  // holds inside/, which is the daemon's, and outside/, which is not
    std::string acquire_control();

    // Stops all that the calls began, and removes what they left. Ends the program where anything was touched
    // that is not the daemon's.
    void begin_anew();

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::fuzz
