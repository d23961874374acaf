#include "server/cameras/studio/session_writer.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <opencv2/imgcodecs.hpp>

#include "common/body_pose.h"
#include "common/calibration_file.h"
#include "common/files.h"
#include "common/geometry.h"
#include "common/session_file.h"
#include "server/cameras/h264_file.h"

namespace kinevox::studio {
namespace {

namespace fs = std::filesystem;

class TruthTables {
  public:
    TruthTables() {
        joints_ = angles_ = "frame,time_s";
        for (std::string_view joint : kJointNames) joints_ += fmt::format(",{0}_x,{0}_y,{0}_z", joint);
        for (std::string_view angle : kJointAngleNames) angles_ += fmt::format(",{}_deg", angle);
        joints_ += '\n';
        angles_ += '\n';
    }
    // Null: the person is not there, all cells are empty.
    void add(std::int64_t frame, double fps, const SubjectTruth* truth) {
        const std::string start = fmt::format("{},{:.5f}", frame, static_cast<double>(frame) / fps);
        joints_ += start;
        angles_ += start;
        if (!truth) {
            joints_.append(3 * kJointNames.size(), ',').append(1, '\n');
            angles_.append(kJointAngleNames.size(), ',').append(1, '\n');
            return;
        }
        for (const Vec3& p : truth->joints_in_world)
            joints_ += fmt::format(",{:.5f},{:.5f},{:.5f}", p.x, p.y, p.z);
        for (double angle : joint_angles(truth->joints_in_world))
            angles_ += fmt::format(",{:.3f}", angle * 180 / 3.14159265358979323846);
        joints_ += '\n';
        angles_ += '\n';
    }
    // joints.csv and angles.csv, or joints_a.csv and angles_a.csv with the suffix "_a".
    absl::Status write(const fs::path& folder, const std::string& suffix) const {
        if (absl::Status status = write_file_atomically(folder / ("joints" + suffix + ".csv"), joints_);
            !status.ok())
            return status;
        return write_file_atomically(folder / ("angles" + suffix + ".csv"), angles_);
    }

  private:
    std::string joints_, angles_;
};

// truth/target.csv: the pose of the target.
class TargetTable {
  public:
    void add(std::int64_t frame, double fps, const Rigid3& world_from_target) {
        const Vec3 at = world_from_target.translation,
                   rotation = rodrigues_from_rotation(world_from_target.rotation);
        text_ += fmt::format("{},{:.5f},{:.6f},{:.6f},{:.6f},{:.5f},{:.5f},{:.5f}\n", frame,
                             static_cast<double>(frame) / fps, at.x, at.y, at.z, degrees(rotation.x),
                             degrees(rotation.y), degrees(rotation.z));
    }
    absl::Status write(const fs::path& folder) const {
        return write_file_atomically(folder / "target.csv", text_);
    }

  private:
    std::string text_ = "frame,time_s,x_m,y_m,z_m,rotation_x_deg,rotation_y_deg,rotation_z_deg\n";
};

// truth/camera_bump.csv and truth/calibration_after_bump.toml.
absl::Status write_bump(const Studio& studio, const fs::path& folder) {
    const CameraBump& bump = *studio.options().staging.bump;
    const double fps = studio.options().fps;
    const auto frame = static_cast<std::int64_t>(std::ceil(bump.time_s * fps));
    std::vector<Camera> after = studio.cameras();
    after[bump.camera] = studio.camera_at(bump.camera, frame);
    if (absl::Status status = write_calibration_toml(after, folder / "calibration_after_bump.toml");
        !status.ok())
        return status;
    return write_file_atomically(
        folder / "camera_bump.csv",
        fmt::format("camera,frame,time_s,rotation_deg\n{},{},{:.5f},{:.4f}\n", after[bump.camera].name, frame,
                    static_cast<double>(frame) / fps, bump.rotation_deg));
}

absl::Status write_mask(const fs::path& file, const Camera& camera, std::vector<std::uint8_t>& mask) {
    const cv::Mat image(camera.height, camera.width, CV_8UC1, mask.data());
    try {
        if (cv::imwrite(file.string(), image)) return absl::OkStatus();
    } catch (const cv::Exception&) {
    }
    return absl::UnavailableError(fmt::format("{}: cannot write the mask; is the disk full?", file.string()));
}

absl::Status write_mesh(const fs::path& file, const Studio::Surface& surface) {
    std::string text = fmt::format(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
        "property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        surface.vertices.size(), surface.triangles.size());
    const auto put = [&](const auto& value) {
        text.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    for (const Vec3& v : surface.vertices)
        for (double c : {v.x, v.y, v.z}) put(static_cast<float>(c));
    for (const auto& t : surface.triangles) {
        put(std::uint8_t{3});
        for (std::uint32_t i : t) put(static_cast<std::int32_t>(i));
    }
    return write_file_atomically(file, text);
}

// Of one of several people, in the names of the files: _a, _b ...; empty for a person alone.
std::string suffix_of(const Studio& studio, std::size_t person) {
    return studio.person_count() > 1 ? fmt::format("_{}", static_cast<char>('a' + person)) : "";
}

// Folders of the masks of one camera: of all people together and, of several, of each.
std::vector<std::string> mask_folders(const Studio& studio, const Camera& camera) {
    std::vector<std::string> names{"masks_" + camera.name};
    for (std::size_t person = 0; studio.person_count() > 1 && person < studio.person_count(); ++person)
        names.push_back(fmt::format("masks{}_{}", suffix_of(studio, person), camera.name));
    return names;
}

absl::Status make_folders(const fs::path& folder, const Studio& studio, const SessionWriterOptions& options) {
    std::error_code error;
    if (fs::exists(folder, error) && (!fs::is_directory(folder, error) || !fs::is_empty(folder, error)))
        return absl::AlreadyExistsError(fmt::format(
            "{}: already exists and is not an empty folder; choose another one", folder.string()));
    std::vector<fs::path> wanted{folder / "background", folder / "truth"};
    const bool person = studio.options().staging.person;
    if (person && options.mesh_stride > 0) wanted.push_back(folder / "truth" / "mesh");
    if (person && options.masks)
        for (const Camera& camera : studio.cameras())
            for (const std::string& name : mask_folders(studio, camera))
                wanted.push_back(folder / "truth" / name);
    for (const fs::path& path : wanted) {
        fs::create_directories(path, error);
        if (error)
            return absl::UnavailableError(
                fmt::format("{}: cannot create the folder: {}", path.string(), error.message()));
    }
    return absl::OkStatus();
}

using Videos = std::vector<std::unique_ptr<H264File>>;

absl::StatusOr<Videos> open_videos(const fs::path& folder, const Studio& studio, int crf) {
    Videos videos;
    for (const Camera& camera : studio.cameras()) {
        absl::StatusOr<std::unique_ptr<H264File>> video = H264File::create(
            folder / (camera.name + ".mp4"), camera.width, camera.height, {studio.options().fps, crf});
        if (!video.ok()) return video.status();
        videos.push_back(*std::move(video));
    }
    return videos;
}

// Calls work(camera) for all cameras in parallel; the first error in the cameras' order.
template <typename Work>
absl::Status for_cameras(const Studio& studio, Work&& work) {
    std::vector<absl::Status> statuses(studio.cameras().size());
    tbb::parallel_for(std::size_t{0}, statuses.size(), [&](std::size_t i) { statuses[i] = work(i); });
    for (const absl::Status& status : statuses)
        if (!status.ok()) return status;
    return absl::OkStatus();
}

absl::Status write_backgrounds(const Studio& studio, const fs::path& folder,
                               const SessionWriterOptions& options) {
    absl::StatusOr<Videos> videos = open_videos(folder, studio, options.crf);
    if (!videos.ok()) return videos.status();
    return for_cameras(studio, [&](std::size_t i) {
        for (int frame = 0; frame < options.background_frames; ++frame)
            if (absl::Status status = (*videos)[i]->write(studio.draw_empty(i, frame)); !status.ok())
                return status;
        return (*videos)[i]->close();
    });
}

// Of one camera; of all people, then of each one.
absl::Status write_masks(const Studio& studio, const fs::path& truth, std::int64_t frame,
                         const Camera& camera, const std::vector<std::uint8_t>& labels) {
    const std::vector<std::string> folders = mask_folders(studio, camera);
    std::vector<std::uint8_t> mask(labels.size());
    for (std::size_t n = 0; n < folders.size(); ++n) {
        for (std::size_t k = 0; k < labels.size(); ++k)
            mask[k] = (n == 0 ? labels[k] != 0 : labels[k] == n) ? 255 : 0;
        if (absl::Status written =
                write_mask(truth / folders[n] / fmt::format("frame_{:04}.png", frame), camera, mask);
            !written.ok())
            return written;
    }
    return absl::OkStatus();
}

absl::Status write_frames(Studio& studio, const fs::path& folder, const SessionWriterOptions& options) {
    absl::StatusOr<Videos> videos = open_videos(folder, studio, options.crf);
    if (!videos.ok()) return videos.status();
    const fs::path truth = folder / "truth";
    std::vector<TruthTables> tables(studio.person_count());
    TargetTable target;
    const Staging& staging = studio.options().staging;
    const bool masks_wanted = options.masks && staging.person;
    for (std::int64_t frame = 0; frame < options.frames; ++frame) {
        const std::vector<Image> images = studio.draw(frame, true);
        std::vector<std::vector<std::uint8_t>> labels;
        if (masks_wanted) labels = studio.labels(frame);
        absl::Status status = for_cameras(studio, [&](std::size_t i) {
            const Camera& camera = studio.cameras()[i];
            absl::Status written = (*videos)[i]->write(images[i]);
            if (written.ok() && masks_wanted) written = write_masks(studio, truth, frame, camera, labels[i]);
            return written;
        });
        if (status.ok() && staging.person && options.mesh_stride > 0 && frame % options.mesh_stride == 0)
            status =
                write_mesh(truth / "mesh" / fmt::format("frame_{:04}.ply", frame), studio.surface(frame));
        if (!status.ok()) return status;
        for (std::size_t person = 0; staging.person && person < tables.size(); ++person) {
            const SubjectTruth exact = studio.truth(frame, person);
            tables[person].add(frame, studio.options().fps,
                               studio.is_present(person, frame) ? &exact : nullptr);
        }
        if (staging.has_target()) target.add(frame, studio.options().fps, studio.world_from_target(frame));
        if (options.progress) options.progress(frame + 1, options.frames);
    }
    for (const std::unique_ptr<H264File>& video : *videos)
        if (absl::Status status = video->close(); !status.ok()) return status;
    if (staging.has_target())
        if (absl::Status status = target.write(truth); !status.ok()) return status;
    if (staging.bump)
        if (absl::Status status = write_bump(studio, truth); !status.ok()) return status;
    for (std::size_t person = 0; staging.person && person < tables.size(); ++person)
        if (absl::Status status = tables[person].write(truth, suffix_of(studio, person)); !status.ok())
            return status;
    return absl::OkStatus();
}

}  // namespace

std::string SessionWriterOptions::check() const {
    if (frames < 1 || frames > 1000000) return fmt::format("frames is {}; it must be 1 .. 1000000", frames);
    if (background_frames < 1 || background_frames > 10000)
        return fmt::format("background_frames is {}; it must be 1 .. 10000", background_frames);
    if (mesh_stride < 0) return fmt::format("mesh_stride is {}; it must be 0 or more", mesh_stride);
    if (crf < 0 || crf > 51) return fmt::format("crf is {}; it must be 0 .. 51", crf);
    return {};
}

absl::Status write_session(Studio& studio, const fs::path& folder, const SessionWriterOptions& options) {
    if (const std::string wrong = options.check(); !wrong.empty())
        return absl::InvalidArgumentError("studio: " + wrong);
    for (const Camera& camera : studio.cameras())
        if (camera.width % 2 || camera.height % 2)
            return absl::InvalidArgumentError(
                fmt::format("studio: size is {}x{}; videos need even sides", camera.width, camera.height));
    const fs::path root = fs::absolute(folder);
    if (absl::Status status = make_folders(root, studio, options); !status.ok()) return status;
    if (absl::Status status = write_calibration_toml(studio.cameras(), root / "calibration.toml");
        !status.ok())
        return status;
    if (absl::Status status = write_backgrounds(studio, root / "background", options); !status.ok())
        return status;
    if (absl::Status status = write_frames(studio, root, options); !status.ok()) return status;
    const Staging& staging = studio.options().staging;
    Session session{.name = staging.person  ? studio.options().motion
                            : staging.board ? "board"
                            : staging.wand  ? "wand"
                                            : "empty",
                    .fps = studio.options().fps,
                    .calibration = root / "calibration.toml",
                    .truth = root / "truth",
                    .cameras = {}};
    for (const Camera& camera : studio.cameras())
        session.cameras.push_back(
            {camera.name, root / (camera.name + ".mp4"), root / "background" / (camera.name + ".mp4")});
    return kinevox::write_session(session, root / "session.toml");
}

}  // namespace kinevox::studio
