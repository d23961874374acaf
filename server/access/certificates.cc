#include "server/access/certificates.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <openssl/bio.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509.h>
#include <openssl/x509v3.h>

#include <ctime>
#include <memory>

namespace kinevox {
namespace {

template <auto kFree>
struct Free {
    template <typename T>
    void operator()(T* object) const {
        kFree(object);
    }
};
using Key = std::unique_ptr<EVP_PKEY, Free<EVP_PKEY_free>>;
using Certificate = std::unique_ptr<X509, Free<X509_free>>;
using Extension = std::unique_ptr<X509_EXTENSION, Free<X509_EXTENSION_free>>;
using Bio = std::unique_ptr<BIO, Free<BIO_free_all>>;
using Asn1Time = std::unique_ptr<ASN1_TIME, Free<ASN1_TIME_free>>;

absl::Status openssl_failed(const char* what) {
    char text[256] = "";
    ERR_error_string_n(ERR_get_error(), text, sizeof text);
    ERR_clear_error();
    return absl::InvalidArgumentError(fmt::format("{}: {}", what, text));
}

Bio reader(const std::string& pem) {
    return Bio(BIO_new_mem_buf(pem.data(), static_cast<int>(pem.size())));
}

std::string text_of(BIO* bio) {
    char* data = nullptr;
    const long size = BIO_get_mem_data(bio, &data);
    return {data, static_cast<std::size_t>(size)};
}

Certificate read_certificate(const std::string& pem) {
    return Certificate(PEM_read_bio_X509(reader(pem).get(), nullptr, nullptr, nullptr));
}

// Without asking for a password.
Key read_key(const std::string& pem) {
    return Key(PEM_read_bio_PrivateKey(
        reader(pem).get(), nullptr, [](char*, int, int, void*) { return 0; }, nullptr));
}

bool set_serial(X509* certificate) {
    unsigned char bits[16];
    if (RAND_bytes(bits, sizeof bits) != 1) return false;
    bits[0] &= 0x7f;  // positive
    BIGNUM* number = BN_bin2bn(bits, sizeof bits, nullptr);
    const bool set = number && BN_to_ASN1_INTEGER(number, X509_get_serialNumber(certificate));
    BN_free(number);
    return set;
}

bool set_time(ASN1_TIME* time, std::int64_t time_s) {
    return ASN1_TIME_set(time, static_cast<std::time_t>(time_s)) != nullptr;
}

// "DNS:hall,IP:10.0.0.5"
std::string alternative_names(const std::vector<std::string>& hosts) {
    std::string text;
    for (const std::string& host : hosts) {
        unsigned char address[16];
        const bool is_address =
            inet_pton(AF_INET, host.c_str(), address) == 1 || inet_pton(AF_INET6, host.c_str(), address) == 1;
        text += fmt::format("{}{}:{}", text.empty() ? "" : ",", is_address ? "IP" : "DNS", host);
    }
    return text;
}

bool add_extension(X509* certificate, X509* issuer, int id, const std::string& value) {
    X509V3_CTX context;
    X509V3_set_ctx_nodb(&context);
    X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
    const Extension extension(X509V3_EXT_conf_nid(nullptr, &context, id, value.c_str()));
    return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

bool add_extensions(const NewCertificate& wanted, X509* certificate, X509* issuer) {
    using Kind = NewCertificate::Kind;
    const auto add = [&](int id, const std::string& value) {
        return add_extension(certificate, issuer, id, value);
    };
    bool good = add(NID_basic_constraints,
                    wanted.kind == Kind::kAuthority ? "critical,CA:TRUE,pathlen:0" : "critical,CA:FALSE") &&
                add(NID_subject_key_identifier, "hash") && add(NID_authority_key_identifier, "keyid") &&
                add(NID_key_usage, wanted.kind == Kind::kAuthority ? "critical,keyCertSign,cRLSign"
                                                                   : "critical,digitalSignature");
    if (wanted.kind == Kind::kServer) good = good && add(NID_ext_key_usage, "serverAuth");
    if (wanted.kind == Kind::kClient) good = good && add(NID_ext_key_usage, "clientAuth");
    if (!wanted.hosts.empty()) good = good && add(NID_subject_alt_name, alternative_names(wanted.hosts));
    return good;
}

absl::StatusOr<CertificateAndKey> to_pem(X509* certificate, EVP_PKEY* key) {
    const Bio certificate_text(BIO_new(BIO_s_mem())), key_text(BIO_new(BIO_s_mem()));
    if (PEM_write_bio_X509(certificate_text.get(), certificate) != 1 ||
        PEM_write_bio_PKCS8PrivateKey(key_text.get(), key, nullptr, nullptr, 0, nullptr, nullptr) != 1)
        return openssl_failed("the certificate cannot be written");
    return CertificateAndKey{text_of(certificate_text.get()), text_of(key_text.get())};
}

}  // namespace

absl::StatusOr<CertificateAndKey> make_certificate(const NewCertificate& wanted,
                                                   const CertificateAndKey* authority) {
    for (const std::string& host : wanted.hosts)
        if (host.empty() || host.find_first_of(",:= \t\n") != std::string::npos) {
            unsigned char address[16];
            if (inet_pton(AF_INET6, host.c_str(), address) != 1)
                return absl::InvalidArgumentError(fmt::format(
                    "'{}' is no host's name or address; give one such as hall.example or 10.0.0.5", host));
        }
    const Key key(EVP_EC_gen("P-256"));
    const Certificate certificate(X509_new());
    Certificate issuer;
    Key issuer_key;
    if (authority) {
        issuer = read_certificate(authority->certificate);
        issuer_key = read_key(authority->key);
        if (!issuer || !issuer_key)
            return openssl_failed("the authority's certificate or key cannot be read");
    }
    X509* const signing = issuer ? issuer.get() : certificate.get();
    if (!key || !certificate) return openssl_failed("no key can be made");
    X509_NAME* const subject = X509_get_subject_name(certificate.get());
    const auto* name = reinterpret_cast<const unsigned char*>(wanted.name.data());
    const bool made =
        X509_set_version(certificate.get(), X509_VERSION_3) == 1 && set_serial(certificate.get()) &&
        X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_UTF8, name, static_cast<int>(wanted.name.size()),
                                   -1, 0) == 1 &&
        X509_set_issuer_name(certificate.get(), X509_get_subject_name(signing)) == 1 &&
        set_time(X509_getm_notBefore(certificate.get()), wanted.from_s) &&
        set_time(X509_getm_notAfter(certificate.get()), wanted.until_s) &&
        X509_set_pubkey(certificate.get(), key.get()) == 1 &&
        add_extensions(wanted, certificate.get(), signing) &&
        X509_sign(certificate.get(), issuer_key ? issuer_key.get() : key.get(), EVP_sha256()) != 0;
    if (!made) return openssl_failed("the certificate cannot be made");
    return to_pem(certificate.get(), key.get());
}

absl::StatusOr<std::int64_t> check_certificate(const std::string& certificate, const std::string& key) {
    const Certificate read = read_certificate(certificate);
    if (!read) return openssl_failed("it is no certificate in PEM");
    if (!key.empty()) {
        const Key own = read_key(key);
        if (!own) return openssl_failed("its key is none in PEM, or asks for a password");
        if (X509_check_private_key(read.get(), own.get()) != 1) {
            ERR_clear_error();
            return absl::FailedPreconditionError("the key belongs to another certificate");
        }
    }
    const Asn1Time epoch(ASN1_TIME_set(nullptr, 0));
    int days = 0, seconds = 0;
    if (!epoch || ASN1_TIME_diff(&days, &seconds, epoch.get(), X509_get0_notAfter(read.get())) != 1)
        return openssl_failed("until when it is valid cannot be read");
    return std::int64_t{days} * 86'400 + seconds;
}

}  // namespace kinevox
