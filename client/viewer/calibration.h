// What the coach does about calibration: a procedure that leads through its steps, and the stored
// calibrations. Each thing that takes time is on a thread of its own, so that the window never waits.
#pragma once

#include <QImage>
#include <QObject>
#include <QString>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "client/viewer/calibration_run.h"
#include "client/viewer/commands.h"

namespace kinevox::viewer {

struct ShownCertificate {
    std::string id;
    v1::Certificate certificate;
    QImage page;  // null until it has come
};

// Signals come on the threads here.
class Calibration final : public QObject {
    Q_OBJECT

  public:
    explicit Calibration(client::ClientOptions options);
    ~Calibration() override;

    // Watching keeps a procedure from ending by itself, of other clients too: only while the coach looks.
    void watch(bool on);

    // A procedure of this window; false while one runs.
    bool begin(const CalibrationPlan& plan);
    void enough();
    // This window's procedure, else whichever is open.
    void cancel();
    bool running() const;
    CalibrationStep step() const;
    std::string lack() const;  // what the last attempt to solve lacked; empty after the next step
    v1::WatchProcedureResponse progress() const;

    bool list();  // answered by stored_came()
    bool apply(const std::string& id, bool although_bad);
    bool undo();
    bool remove(const std::string& id);
    bool show_certificate(
        const std::string& id);  // answered by certificate_came(), twice: without and with its page
    v1::ListCalibrationsResponse stored() const;
    ShownCertificate certificate() const;

  signals:
    void progress_came();
    void stored_came();
    void certificate_came();
    void solved(const QString& id);
    void done(const QString& message);
    void failed(const QString& message);

  private:
    void watch_all(const std::stop_token& stop);
    void changed(const std::function<void()>& change);
    bool change(
        const QString& what,
        std::function<absl::Status(client::Client&, const std::string& lease, std::string& done)> act);

    const client::ClientOptions options_;
    mutable std::mutex mutex_;
    v1::WatchProcedureResponse progress_;
    v1::ListCalibrationsResponse stored_;
    ShownCertificate certificate_;
    CalibrationStep step_ = CalibrationStep::kNone;
    std::string lack_;
    bool running_ = false;
    std::shared_ptr<CalibrationRun> run_;  // null: none

    Commands commands_, pages_;               // a page takes seconds to be drawn
    std::jthread watching_, running_thread_;  // the owner's thread starts and ends them
};

}  // namespace kinevox::viewer
