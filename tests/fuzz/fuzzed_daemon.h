// The daemon's parts around a fake capture, in their own folder, served on a free local port.
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

    // kNoToken sends no token, kTwoTokens two.
    const std::string& token(Who who) const;
    // Whether the caller's role grants the method; never for kExpired, kWrongToken and kNoToken.
    bool may(Who who, const std::string& path) const;

    std::shared_ptr<grpc::Channel> channel() const;
    void give(int frame_sets);
    const std::filesystem::path& root() const;  // contains inside/ (the daemon's) and outside/
    std::string acquire_control();

    // Stops everything that the calls started and removes their files. Aborts if a file outside inside/ was
    // changed.
    void reset();

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace kinevox::fuzz
