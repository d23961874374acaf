#include "server/recording/anonymous_session.h"

namespace kinevox {

std::string anonymous_readme() {
    return R"(A motion capture without images, written by `kinevox export --anonymous`.

Contents
  video.mp4           the silhouettes with the measured skeleton
  session.toml        a Kinevox recording: `kinevox process`, `export` and `replay` read it
  cam_NN.mkv, .index  per camera the subject's silhouette, white on black, lossless
  cam_NN_background.mkv  the matching background: black
  calibration.toml    the cameras: metres, pixels (OpenCV's model, aniposelib's form)
  frames.csv          times of the frame sets, relative to the first one
  joints.csv, angles.csv, coordinates.csv, uncertainty.csv, withheld.csv, body.toml
                      the measured poses: metres, degrees
  volumes.kvxv        the volume of each frame set, carved from the silhouettes

Removed
  images of the cameras and of the background, all colours, the names of recording, subject and cameras, date and time of
  day, the certificate of the calibration

What still identifies the subject
  Body shape, measurements and movement are personal. Anyone who already has them, or the images, can identify the
  subject: this data is pseudonymous, and data protection law may still apply.
)";
}

}  // namespace kinevox
