// The words for calibrations that the command line and the viewer share.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "client/lib/guided_calibration.h"

namespace kinevox::client {
namespace {

TEST(MethodText, NamesEveryMethod) {
    const auto& methods = *v1::CalibrationMethod_descriptor();
    std::set<std::string> texts;
    for (int i = 0; i < methods.value_count(); ++i)
        texts.insert(method_text(static_cast<v1::CalibrationMethod>(methods.value(i)->number())));
    EXPECT_EQ(texts.size(), static_cast<std::size_t>(methods.value_count())) << "one has no name of its own";
    EXPECT_EQ(texts.count("unknown method"), 1u) << "of UNSPECIFIED only";
}

TEST(VerdictText, NamesEveryVerdict) {
    EXPECT_EQ(verdict_text(v1::VERDICT_GO, "-"), "GO");
    EXPECT_EQ(verdict_text(v1::VERDICT_CAUTION, "-"), "CAUTION");
    EXPECT_EQ(verdict_text(v1::VERDICT_NO_GO, "-"), "NO-GO");
    EXPECT_EQ(verdict_text(v1::VERDICT_UNSPECIFIED, "not checked"), "not checked");
}

}  // namespace
}  // namespace kinevox::client
