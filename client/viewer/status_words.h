// How it goes, in plain words: what a coach reads in the status line.
#pragma once

#include <optional>
#include <string>

#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"

namespace kinevox::viewer {

struct Link {
    std::string server;              // HOST:PORT
    bool connected = false;          // the last call or message came through
    std::string problem;             // why not, one line
    double silent_s = 0;             // since the last message of any kind
    std::optional<double> delay_ms;  // from the capture to the painted picture, median
};

enum class Mood { kGood, kCare, kBad };

struct Words {
    Mood mood = Mood::kGood;
    std::string state;   // one or two words: "Live", "Stopped", "Replay"
    std::string line;    // rate, delay, cameras
    std::string remedy;  // what is wrong and what to do; empty where nothing is
};

// Whether a recording stands in the cameras' place.
bool replayed(const v1::Replay* replay);

struct CameraTrouble {
    std::string short_word;  // for its picture
    std::string line;        // what it is and what to do
    int gravity = 0;         // 0: nothing is wrong; the most is the worst
};
// `subject`: somebody is tracked, so that cameras can be compared.
CameraTrouble camera_trouble(const v1::CameraStatus& camera, bool subject);

// `status`, `recorder`, `replay`: the newest that came; null: none yet.
Words in_words(const Link& link, const v1::GetStatusResponse* status,
               const v1::GetRecorderStatusResponse* recorder, const v1::Replay* replay);

}  // namespace kinevox::viewer
