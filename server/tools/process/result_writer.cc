#include "server/tools/process/result_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <thread>
#include <utility>

#include "common/atomic_file.h"
#include "common/background_priority.h"
#include "common/ply.h"
#include "server/cameras/image_mat.h"
#include "server/tools/process/tables.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPartial = ".kinevox-partial";

std::string six_digits(std::uint64_t frame, std::string_view ending) {
    return fmt::format("{:06d}{}", frame, ending);
}

absl::Status cannot_write(const fs::path& file, std::string_view why) {
    return absl::InternalError(
        fmt::format("{} cannot be written ({}); check free space and permissions", file.string(), why));
}

class FolderWriter final : public ResultWriter {
  public:
    FolderWriter(fs::path folder, std::vector<std::string> names, const ResultWriterOptions& options)
        : folder_(std::move(folder)),
          partial_(folder_ / kPartial),
          names_(std::move(names)),
          options_(options),
          tables_(names_) {}

    ~FolderWriter() override {
        {
            const std::lock_guard lock(mutex_);
            waiting_.clear();
        }
        end_threads();
        std::error_code ignored;
        if (opened_) fs::remove_all(partial_, ignored);
        if (made_folder_) fs::remove(folder_, ignored);  // only if it is empty
        if (lock_ >= 0) ::close(lock_);
    }

    absl::Status open() {
        std::error_code error;
        made_folder_ = fs::create_directories(folder_, error);
        if (error) return cannot_write(folder_, error.message());
        if (absl::Status alone = lock(); !alone.ok()) return alone;
        opened_ = true;
        fs::remove_all(partial_, error);
        fs::create_directories(partial_, error);
        if (error) return cannot_write(partial_, error.message());
        if (options_.save_silhouettes)
            for (const std::string& name : names_)
                fs::create_directories(partial_ / "silhouettes" / name, error);
        if (options_.save_volumes) fs::create_directories(partial_ / "volumes", error);
        if (error) return cannot_write(partial_, error.message());
        if (options_.save_silhouettes || options_.save_volumes)
            for (int n = 0; n < std::max(options_.threads, 1); ++n)
                threads_.emplace_back([this] { write_waiting(); });
        return absl::OkStatus();
    }

    absl::Status add(FrameResultPtr result) override {
        tables_.add(*result);
        std::unique_lock lock(mutex_);
        if (threads_.empty()) return status_;
        changed_.wait(lock, [this] { return static_cast<int>(waiting_.size()) < options_.max_waiting; });
        waiting_.push_back(std::move(result));
        changed_.notify_all();
        return status_;
    }

    void add_table(Table table) override { more_tables_.push_back(std::move(table)); }

    absl::Status finish() override;

  private:
    // The kernel releases it when this process ends for any reason.
    absl::Status lock() {
        lock_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (lock_ < 0) return cannot_write(folder_, std::generic_category().message(errno));
        if (flock(lock_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK)
            return absl::OkStatus();  // some file systems have no locks
        return absl::FailedPreconditionError(fmt::format(
            "{}: another kinevox process is writing there; wait for it or change --out", folder_.string()));
    }

    void write_waiting();
    void end_threads();
    absl::Status write_one(const FrameResult& result) const;

    fs::path folder_, partial_;
    std::vector<std::string> names_;
    ResultWriterOptions options_;
    ResultTables tables_;
    std::vector<Table> more_tables_;
    bool made_folder_ = false;
    bool opened_ = false;  // else the partial results belong to another process
    int lock_ = -1;

    std::mutex mutex_;  // guards the members below, but threads_
    std::condition_variable changed_;
    std::deque<FrameResultPtr> waiting_;
    bool no_more_ = false;
    absl::Status status_;
    std::vector<std::thread> threads_;
};

absl::Status FolderWriter::write_one(const FrameResult& result) const {
    if (options_.save_silhouettes)
        for (std::size_t c = 0; c < names_.size(); ++c) {
            const kernels::Silhouettes& s = result.silhouettes[c];
            if (s.sharp.empty()) continue;  // the camera delivered no image
            const cv::Mat image = as_mat(s.sharp.data(), s.width, s.height);
            const fs::path file = partial_ / "silhouettes" / names_[c] / six_digits(result.sequence, ".png");
            std::vector<std::uint8_t> png;
            if (!cv::imencode(".png", image, png,
                              {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_BILEVEL, 1}))
                return cannot_write(file, "PNG encoding failed");
            const std::string_view bytes(reinterpret_cast<const char*>(png.data()), png.size());
            if (absl::Status written = write_file_atomically(file, bytes); !written.ok()) return written;
        }
    if (options_.save_volumes && result.volume)
        return write_volume_ply(*result.volume, partial_ / "volumes" / six_digits(result.sequence, ".ply"));
    return absl::OkStatus();
}

void FolderWriter::write_waiting() {
    lower_this_threads_priority();
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return no_more_ || !waiting_.empty(); });
        if (waiting_.empty()) return;
        const FrameResultPtr result = std::move(waiting_.front());
        waiting_.pop_front();
        changed_.notify_all();
        if (!status_.ok()) continue;  // drain
        lock.unlock();
        absl::Status written = write_one(*result);
        lock.lock();
        if (!written.ok() && status_.ok()) status_ = std::move(written);
    }
}

void FolderWriter::end_threads() {
    {
        const std::lock_guard lock(mutex_);
        no_more_ = true;
        changed_.notify_all();
    }
    for (std::thread& thread : threads_)
        if (thread.joinable()) thread.join();
}

absl::Status FolderWriter::finish() {
    end_threads();
    if (!status_.ok()) return status_;
    std::vector<std::string> made;
    if (options_.save_silhouettes) made.emplace_back("silhouettes");
    if (options_.save_volumes) made.emplace_back("volumes");
    std::vector<Table> tables = tables_.tables();
    tables.insert(tables.end(), more_tables_.begin(), more_tables_.end());
    for (const Table& table : tables) {
        made.emplace_back(table.file_name);
        if (absl::Status written = write_file_atomically(partial_ / table.file_name, table.text);
            !written.ok())
            return written;
    }
    // Results of an earlier run go even if this run has none of their kind; its run.toml first, since what is
    // half replaced is not complete.
    std::error_code error;
    std::vector<fs::path> old{folder_ / "run.toml"};
    for (const char* name : {"silhouettes", "volumes", "joints.csv", "angles.csv", "coordinates.csv",
                             "uncertainty.csv", "withheld.csv", "body.toml"})
        old.push_back(folder_ / name);
    for (const auto& entry : fs::directory_iterator(folder_, error))
        if (const std::string name = entry.path().filename().string();
            name.starts_with("body_") && name.ends_with(".toml"))
            old.push_back(entry.path());
    for (const fs::path& each : old) {
        fs::remove_all(each, error);
        if (error) return cannot_write(each, error.message());
    }
    for (const std::string& name : made) {
        fs::rename(partial_ / name, folder_ / name, error);
        if (error) return cannot_write(folder_ / name, error.message());
    }
    fs::remove_all(partial_, error);
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<ResultWriter>> ResultWriter::create(const fs::path& folder,
                                                                   std::vector<std::string> camera_names,
                                                                   const ResultWriterOptions& options) {
    auto writer = std::make_unique<FolderWriter>(folder, std::move(camera_names), options);
    if (absl::Status opened = writer->open(); !opened.ok()) return opened;
    return writer;
}

}  // namespace kinevox
