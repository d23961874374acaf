// Uses settings of its own instead of the user's.
#include <gtest/gtest.h>

#include <QApplication>

#include "tests/support/small_session.h"

int main(int argc, char** argv) {
    ::testing::InitGoogleTest(&argc, argv);
    const kinevox::testing::TemporaryFolder settings;
    qputenv("XDG_CONFIG_HOME", settings.path().c_str());
    QApplication application(argc, argv);
    QApplication::setOrganizationName("Kinevox");
    QApplication::setApplicationName("viewer");
    return RUN_ALL_TESTS();
}
