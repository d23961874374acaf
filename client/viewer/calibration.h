// Guided calibration and the stored calibrations. Calls to the daemon run on threads of their own, so that
// the window never blocks.
#pragma once

#include <QImage>
#include <QObject>
#include <QString>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/lib/guided_calibration.h"
#include "client/viewer/commands.h"

namespace kinevox::viewer {

using client::CalibrationStep;
using client::finding_line;

// Texts for calibrating, in calibration_text.cc: the instruction of each step, and the result's certificate.

struct CalibrationKindText {
    v1::ProcedureKind kind;
    const char* name;     // in a list
    const char* purpose;  // one or two sentences
};
const std::vector<CalibrationKindText>& calibration_kinds();

// What the person in the space does now; short, to be read from a distance.
std::string instruction(v1::ProcedureKind kind, CalibrationStep step);
// The step of any client's procedure.
CalibrationStep step_of(const v1::WatchProcedureResponse& progress);
// "GO", or "not checked", and what it means.
std::string verdict_text(v1::Verdict verdict);
std::string verdict_sentence(v1::Verdict verdict);
// Name and value of each known quality measure.
std::vector<std::pair<std::string, std::string>> certificate_values(const v1::Certificate& certificate);

struct ShownCertificate {
    std::string id;
    v1::Certificate certificate;
    QImage page;  // null until received
};

// Signals are emitted on threads of this object.
class Calibration final : public QObject {
    Q_OBJECT

  public:
    explicit Calibration(client::ClientOptions options);
    ~Calibration() override;

    // A watched procedure, of any client, does not time out; so watch only while the panel is visible.
    void watch(bool on);

    // Starts a procedure of this window; false while one runs.
    bool begin(const client::CalibrationPlan& plan);
    void finish_step();
    // This window's procedure, else that of another client.
    void cancel();
    bool running() const;
    CalibrationStep step() const;
    // Why the latest attempt to solve lacked observations; empty after the next step.
    std::string insufficient_reason() const;
    v1::WatchProcedureResponse progress() const;

    bool list();  // emits stored_received()
    bool apply(const std::string& id, bool force);
    bool undo();
    bool delete_calibration(const std::string& id);
    // Emits certificate_received() twice: without and with the page.
    bool show_certificate(const std::string& id);
    v1::ListCalibrationsResponse stored() const;
    ShownCertificate certificate() const;

  signals:
    void progress_received();
    void stored_received();
    void certificate_received();
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
    std::string insufficient_reason_;
    bool running_ = false;
    std::shared_ptr<client::GuidedCalibration> procedure_;  // null: none

    Commands commands_, pages_;               // separate queues: drawing a page takes seconds
    std::jthread watching_, running_thread_;  // started and ended on the owner's thread
};

}  // namespace kinevox::viewer
