#include "client/viewer/calibration.h"

#include <utility>

namespace kinevox::viewer {
namespace {

constexpr std::chrono::milliseconds kRetryPause{500};

std::string applied_text(const std::string& id, bool active) {
    return (id.empty() ? "the source's own calibration" : "calibration " + id) +
           (active ? " is active" : " is used from the next start of the capture");
}

}  // namespace

Calibration::Calibration(client::ClientOptions options)
    : options_(std::move(options)), commands_(options_), pages_(options_) {
    for (const Commands* commands : {&commands_, &pages_}) {
        connect(commands, &Commands::done, this, &Calibration::done, Qt::DirectConnection);
        connect(commands, &Commands::failed, this, &Calibration::failed, Qt::DirectConnection);
    }
}

Calibration::~Calibration() {
    watch(false);
    std::shared_ptr<client::GuidedCalibration> procedure;
    changed([&] { procedure = procedure_; });
    if (procedure) procedure->stop();
}

void Calibration::changed(const std::function<void()>& change) {
    const std::scoped_lock lock(mutex_);
    change();
}

bool Calibration::running() const {
    const std::scoped_lock lock(mutex_);
    return running_;
}

CalibrationStep Calibration::step() const {
    const std::scoped_lock lock(mutex_);
    return step_;
}

std::string Calibration::insufficient_reason() const {
    const std::scoped_lock lock(mutex_);
    return insufficient_reason_;
}

v1::WatchProcedureResponse Calibration::progress() const {
    const std::scoped_lock lock(mutex_);
    return progress_;
}

v1::ListCalibrationsResponse Calibration::stored() const {
    const std::scoped_lock lock(mutex_);
    return stored_;
}

ShownCertificate Calibration::certificate() const {
    const std::scoped_lock lock(mutex_);
    return certificate_;
}

void Calibration::watch(bool on) {
    if (on == watching_.joinable()) return;
    if (on) {
        watching_ = std::jthread([this](const std::stop_token& stop) { watch_all(stop); });
    } else {
        watching_.request_stop();
        watching_ = {};
    }
}

void Calibration::watch_all(const std::stop_token& stop) {
    client::Client client(options_);
    std::mutex waiting;
    std::condition_variable_any wake;
    while (!stop.stop_requested()) {
        client
            .watch_procedure(
                [this](const v1::WatchProcedureResponse& progress) {
                    changed([&] { progress_ = progress; });
                    emit progress_received();
                    return true;
                },
                {.reconnect = true, .on_reconnect = {}, .stop = stop})
            .IgnoreError();  // the status line reports connection errors
        std::unique_lock lock(waiting);
        wake.wait_for(lock, stop, kRetryPause, [] { return false; });
    }
}

bool Calibration::begin(const client::CalibrationPlan& plan) {
    if (running()) return false;
    client::CalibrationObserver observer;
    observer.on_step = [this](CalibrationStep step) {
        changed([&] {
            step_ = step;
            if (step != CalibrationStep::kMovingTarget) insufficient_reason_.clear();
        });
        emit progress_received();
    };
    observer.on_progress = [this](const v1::WatchProcedureResponse& progress) {
        changed([&] { progress_ = progress; });
        emit progress_received();
        return true;
    };
    observer.on_insufficient = [this](const std::string& reason) {
        changed([&] { insufficient_reason_ = reason; });
    };
    const auto procedure = std::make_shared<client::GuidedCalibration>(plan, std::move(observer));
    changed([&] {
        procedure_ = procedure;
        running_ = true;
        insufficient_reason_.clear();
    });
    running_thread_ = std::jthread([this, procedure] {
        client::Client client(options_);
        const absl::StatusOr<std::string> id = procedure->run(client, kOperatorName);
        changed([this] {
            running_ = false;
            procedure_.reset();
        });
        emit progress_received();
        if (id.ok())
            emit solved(QString::fromStdString(*id));
        else if (!absl::IsCancelled(id.status()))
            emit failed(tr("Calibration: ") + QString::fromStdString(std::string(id.status().message())));
    });
    return true;
}

void Calibration::finish_step() {
    std::shared_ptr<client::GuidedCalibration> procedure;
    changed([&] { procedure = procedure_; });
    if (procedure) procedure->finish_step();
}

void Calibration::cancel() {
    std::shared_ptr<client::GuidedCalibration> procedure;
    changed([&] { procedure = procedure_; });
    if (procedure) return procedure->stop();
    change(tr("Cancel calibration"), [](client::Client& c, const std::string& lease, std::string& done) {
        v1::CancelProcedureRequest request;
        request.set_lease_id(lease);
        done = "calibration cancelled";
        return c.cancel_procedure(request).status();
    });
}

bool Calibration::change(const QString& what,
                         std::function<absl::Status(client::Client&, const std::string&, std::string&)> act) {
    const bool accepted =
        commands_.enqueue(what, [act = std::move(act)](client::Client& c, std::string& done) {
            return c.with_control(kOperatorName,
                                  [&](const client::Lease& lease) { return act(c, lease.id, done); });
        });
    list();  // after it, in the same queue
    return accepted;
}

bool Calibration::list() {
    return commands_.enqueue(tr("List calibrations"), [this](client::Client& c, std::string&) {
        auto response = c.list_calibrations({});
        if (!response.ok()) return response.status();
        changed([&] { stored_ = *std::move(response); });
        emit stored_received();
        return absl::OkStatus();
    });
}

bool Calibration::apply(const std::string& id, bool force) {
    return change(tr("Apply calibration %1").arg(QString::fromStdString(id)),
                  [=](client::Client& c, const std::string& lease, std::string& done) {
                      v1::ApplyCalibrationRequest request;
                      request.set_lease_id(lease);
                      request.set_calibration_id(id);
                      request.set_restart_capture(true);
                      request.set_force(force);
                      const auto response = c.apply_calibration(request);
                      if (response.ok()) done = applied_text(id, response->active());
                      return response.status();
                  });
}

bool Calibration::undo() {
    return change(tr("Undo calibration"), [](client::Client& c, const std::string& lease, std::string& done) {
        v1::UndoCalibrationRequest request;
        request.set_lease_id(lease);
        request.set_restart_capture(true);
        const auto response = c.undo_calibration(request);
        if (response.ok()) done = applied_text(response->calibration_id(), response->active());
        return response.status();
    });
}

bool Calibration::delete_calibration(const std::string& id) {
    return change(tr("Delete calibration %1").arg(QString::fromStdString(id)),
                  [=](client::Client& c, const std::string& lease, std::string& done) {
                      v1::DeleteCalibrationRequest request;
                      request.set_lease_id(lease);
                      request.set_calibration_id(id);
                      done = "calibration " + id + " deleted";
                      return c.delete_calibration(request).status();
                  });
}

bool Calibration::show_certificate(const std::string& id) {
    const auto get = [this, id](bool include_page) {
        return [this, id, include_page](client::Client& c, std::string&) {
            v1::GetCertificateRequest request;
            request.set_calibration_id(id);
            request.set_include_page(include_page);
            const auto response = c.get_certificate(request);
            if (!response.ok()) return response.status();
            QImage page;
            if (include_page) page.loadFromData(QByteArray::fromStdString(response->page_png()), "PNG");
            changed([&] { certificate_ = {id, response->certificate(), page}; });
            emit certificate_received();
            return absl::OkStatus();
        };
    };
    return pages_.enqueue(tr("Certificate"), get(false)) && pages_.enqueue(tr("Certificate page"), get(true));
}

}  // namespace kinevox::viewer
