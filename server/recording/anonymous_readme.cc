#include "server/recording/anonymous_session.h"

namespace kinevox {

std::string anonymous_readme() {
    return R"(A motion capture without pictures, written by `kinevox export --anonymous`.

What is here
  film.mp4            the silhouettes with the measured skeleton
  session.toml        a recording of Kinevox: `kinevox process`, `export` and `replay` take it
  cam_NN.mkv, .index  per camera the person's silhouette, white on black, lossless
  cam_NN_empty.mkv    the empty scene that belongs to it: black
  calibration.toml    the cameras: metres, pixels (OpenCV's model, aniposelib's form)
  frames.csv          the times of the frame sets, from the first one
  joints.csv, angles.csv, coordinates.csv, uncertainty.csv, withheld.csv, body.toml
                      what was measured: metres, degrees
  volumes.kvxv        the volume of each frame set, carved from the silhouettes

What was left out
  the cameras' pictures and those of the empty room, all colours, the names of recording, subject and cameras, the date
  and the time of day, the certificate of the calibration

What remains
  The shape of the body, its measures and its movement are the person's own. Who has them already, or has the pictures, can
  tell whose they are: this is a pseudonym, and where the law protects such data it still does.
)";
}

}  // namespace kinevox
