// Every call of every service, with every role and with what is no token.
#include <google/protobuf/descriptor.h>

#include <random>
#include <set>

#include "kinevox/v1/stream_service.pb.h"
#include "tests/integration/access/access_fixture.h"

namespace kinevox {
namespace {

using ::testing::UnorderedElementsAre;

bool denied(const grpc::Status& status) {
    return status.error_code() == grpc::StatusCode::UNAUTHENTICATED ||
           status.error_code() == grpc::StatusCode::PERMISSION_DENIED;
}

// Accepted streams stay open until their deadline.
std::chrono::milliseconds limit_of(const CallTable::Call& call) {
    const bool stays_open = !call.method || call.method->server_streaming();
    return std::chrono::milliseconds(stays_open ? 300 : 10'000);
}

std::set<std::string> calls_of(v1::Role role, const CallTable& table) {
    std::set<std::string> calls;
    for (const auto& [path, call] : table.calls())
        if (call.method && has(role, call.permission)) calls.insert(call.method->name());
    return calls;
}

class RolesTest : public AccessTest {};

// Reflection knows what the server has; the table must know the same.
TEST_F(RolesTest, CoverEveryService) {
    serve();
    grpc::GenericStub stub(plain());
    grpc::CompletionQueue queue;
    grpc::ClientContext context;
    context.AddMetadata("authorization", tokens_[v1::ROLE_VIEWER]);
    auto asking =
        stub.PrepareCall(&context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
    void* tag = nullptr;
    bool ok = false;
    asking->StartCall(nullptr);
    queue.Next(&tag, &ok);
    const grpc::Slice list_services(std::string("\x3a\x01*"));
    asking->WriteLast(grpc::ByteBuffer(&list_services, 1), {}, nullptr);
    queue.Next(&tag, &ok);
    grpc::ByteBuffer answer;
    asking->Read(&answer, nullptr);
    queue.Next(&tag, &ok);
    ASSERT_TRUE(ok);
    grpc::Slice bytes;
    ASSERT_TRUE(answer.DumpToSingleSlice(&bytes).ok());
    const std::string text(reinterpret_cast<const char*>(bytes.begin()), bytes.size());
    context.TryCancel();
    grpc::Status status;
    asking->Finish(&status, nullptr);
    queue.Next(&tag, &ok);
    queue.Shutdown();
    while (queue.Next(&tag, &ok)) {
    }

    std::set<std::string> known, served;
    for (const auto& [path, call] : guard_->calls().calls())
        known.insert(path.substr(1, path.find('/', 1) - 1));
    for (std::size_t at = 0; at < text.size(); ++at) {  // a name stands behind its length
        const std::size_t length = static_cast<unsigned char>(text[at]);
        const std::string name = text.substr(at + 1, length);
        if (name.size() == length && (name.starts_with("kinevox.v1.") || name.starts_with("grpc.")) &&
            name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._") ==
                std::string::npos)
            served.insert(name);
    }
    EXPECT_GE(served.size(), 8u);
    EXPECT_EQ(known, served);
}

TEST_F(RolesTest, AssignPermissionToEveryMethod) {
    serve();
    for (const auto& [path, call] : guard_->calls().calls()) {
        EXPECT_NE(call.permission, v1::PERMISSION_UNSPECIFIED) << path << ": name it in access.proto";
        EXPECT_TRUE(has(v1::ROLE_ADMIN, call.permission)) << path;
    }
    EXPECT_GE(guard_->calls().calls().size(), 49u);
}

// By hand: a permission that was given by mistake fails here.
TEST_F(RolesTest, LimitDisplaysAndViewers) {
    serve();
    EXPECT_THAT(
        calls_of(v1::ROLE_DISPLAY, guard_->calls()),
        UnorderedElementsAre("GetStatus", "ListCameras", "StreamVolumes", "StreamPoses", "StreamPreviews"));
    EXPECT_THAT(
        calls_of(v1::ROLE_VIEWER, guard_->calls()),
        UnorderedElementsAre("GetStatus", "ListCameras", "StreamVolumes", "StreamPoses", "StreamPreviews",
                             "WatchEvents", "WatchProcedure", "ListCalibrations", "GetCertificate",
                             "ExportCalibration", "ListLibraryPoses", "WatchPoseDatabase", "WatchBody",
                             "ListSubjects", "GetRecorderStatus", "GetReplay"));
    std::set<std::string> only_administrators;
    const auto operators = calls_of(v1::ROLE_OPERATOR, guard_->calls());
    for (const std::string& call : calls_of(v1::ROLE_ADMIN, guard_->calls()))
        if (!operators.contains(call)) only_administrators.insert(call);
    EXPECT_THAT(only_administrators,
                UnorderedElementsAre("DeleteCalibration", "DeleteLibraryPose", "DeleteRecording"));
}

TEST_F(RolesTest, AllowGrantedMethodsOnly) {
    serve();
    const auto channel = plain();
    for (const auto& [path, what] : guard_->calls().calls())
        for (const v1::Role role : kRoles) {
            const grpc::Status status = call(channel, path, {tokens_[role]}, "", limit_of(what));
            if (path.ends_with("/StreamPreviews")) continue;  // its request says what for; see below
            if (has(role, what.permission))
                EXPECT_FALSE(denied(status))
                    << path << " as " << name_of(role) << ": " << status.error_message();
            else
                EXPECT_EQ(status.error_code(), grpc::StatusCode::PERMISSION_DENIED)
                    << path << " as " << name_of(role);
        }
}

TEST_F(RolesTest, RestrictImagesMoreThanSilhouettes) {
    serve();
    const auto channel = plain();
    using Request = v1::StreamPreviewsRequest;
    for (const auto kind : {Request::KIND_UNSPECIFIED, Request::KIND_IMAGE, Request::KIND_SILHOUETTE})
        for (const v1::Role role : kRoles) {
            Request request;
            request.set_camera(runner_.cameras().front().name);
            request.set_kind(kind);
            const grpc::Status status =
                call(channel, "/kinevox.v1.StreamService/StreamPreviews", {tokens_[role]},
                     request.SerializeAsString(), std::chrono::milliseconds(300));
            const bool may =
                kind == Request::KIND_SILHOUETTE || role == v1::ROLE_OPERATOR || role == v1::ROLE_ADMIN;
            EXPECT_EQ(status.error_code(),
                      may ? grpc::StatusCode::DEADLINE_EXCEEDED : grpc::StatusCode::PERMISSION_DENIED)
                << Request::Kind_Name(kind) << " as " << name_of(role) << ": " << status.error_message();
        }
}

// A mistyped or outdated name grants nothing, but is an error.
TEST_F(RolesTest, ListExistingMethodsAndValuesOnly) {
    serve();
    std::set<std::string> calls, values;
    for (const auto& [path, what] : guard_->calls().calls()) {
        if (!what.method) continue;
        EXPECT_TRUE(calls.insert(what.method->service()->name() + "." + what.method->name()).second);
        const auto* request = what.method->input_type();
        for (int i = 0; i < request->field_count(); ++i)
            if (const auto* type = request->field(i)->enum_type())
                for (int n = 0; n < type->value_count(); ++n)
                    values.insert(request->name() + "." + type->value(n)->name());
    }
    const auto* permissions = v1::Permission_descriptor();
    for (int i = 0; i < permissions->value_count(); ++i) {
        const auto& options = permissions->value(i)->options();
        for (int n = 0; n < options.ExtensionSize(v1::methods); ++n)
            EXPECT_EQ(calls.erase(options.GetExtension(v1::methods, n)), 1u)
                << options.GetExtension(v1::methods, n);
        for (int n = 0; n < options.ExtensionSize(v1::enum_values); ++n) {
            EXPECT_TRUE(values.contains(options.GetExtension(v1::enum_values, n)))
                << options.GetExtension(v1::enum_values, n);
            // The one handler that looks at them; the test above tries it.
            EXPECT_TRUE(options.GetExtension(v1::enum_values, n).starts_with("StreamPreviewsRequest."));
        }
    }
    EXPECT_TRUE(calls.empty());
}

TEST_F(RolesTest, RejectTenThousandWrongTokens) {
    const std::int64_t now_s = seconds_now();
    const std::string expired = create("expired", v1::ROLE_ADMIN, 1, now_s - 2 * 86'400);
    const std::string revoked = create("revoked", v1::ROLE_ADMIN);
    ASSERT_TRUE(revoke_token(token_file_, "revoked", now_s).ok());
    serve();
    const auto channel = plain();
    std::vector<std::pair<std::string, CallTable::Call>> calls(guard_->calls().calls().begin(),
                                                               guard_->calls().calls().end());
    std::mt19937 random(1);
    const auto draw = [&](std::size_t below) { return random() % below; };
    const std::string& good = tokens_[v1::ROLE_ADMIN];
    const auto wrong = [&](int kind) -> std::vector<std::string> {
        std::string token = good;
        switch (kind) {
            case 0:
                return {};
            case 1:
                return {expired};
            case 2:
                return {revoked};
            case 3:
                return {token.substr(0, draw(token.size()))};
            case 4:
                return {token + token[token.size() - 1 - draw(8)]};
            case 5:
                return {token, token};  // twice
            case 6:
                return {tokens_[v1::ROLE_VIEWER], token};
            case 7:
                return {token.substr(7)};  // without its scheme
            case 8:
                return {"Basic " + token.substr(7)};
            case 9: {
                for (char& c : token) c = static_cast<char>(33 + draw(94));
                return {"Bearer " + token};
            }
            case 10:
                return {"Bearer " + to_hex(sha256(token.substr(7)))};  // what the file holds
            case 11:
                return {"Bearer " + std::string(1 + draw(6000), 'a')};
            default: {
                char& c = token[11 + draw(token.size() - 11)];
                c = c == 'A' ? 'B' : 'A';
                return {token};
            }
        }
    };
    int attempts = 0;
    for (; attempts < 10'000; ++attempts) {
        const auto& [path, what] = calls[draw(calls.size())];
        const int kind = attempts % 13;
        const grpc::Status status = call(channel, path, wrong(kind), "", std::chrono::seconds(5));
        ASSERT_EQ(status.error_code(), grpc::StatusCode::UNAUTHENTICATED)
            << path << ", kind " << kind << ": " << status.error_message();
    }
    EXPECT_EQ(attempts, 10'000);
    EXPECT_FALSE(denied(call(channel, "/kinevox.v1.CaptureService/GetStatus", {good})));  // the door is there
}

TEST_F(RolesTest, RejectUnknownMethods) {
    serve();
    const auto channel = plain();
    for (const char* path :
         {"/kinevox.v1.CaptureService/Begin", "/kinevox.v1.NoService/Start", "/kinevox.v1.CaptureService/",
          "/kinevox.v1.CaptureService/start", "/Start", "/"}) {
        EXPECT_EQ(call(channel, path, {}).error_code(), grpc::StatusCode::UNAUTHENTICATED) << path;
        EXPECT_EQ(call(channel, path, {tokens_[v1::ROLE_ADMIN]}).error_code(),
                  grpc::StatusCode::UNIMPLEMENTED)
            << path;
    }
}

}  // namespace
}  // namespace kinevox
