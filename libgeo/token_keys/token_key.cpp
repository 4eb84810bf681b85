#include "token_keys/token_key.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <p11-kit/p11-kit.h>
#include <p11-kit/uri.h>
#include <string.h>  // NOLINT(modernize-deprecated-headers): explicit_bzero

#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"

namespace nadir {
namespace {

constexpr std::string_view kScheme = "pkcs11:";
constexpr std::size_t kMaxPin_bytes = 256;
constexpr std::size_t kRaw_bytes = 32;  // of an Ed25519 public key
constexpr unsigned long kMaxSlots = 256, kMaxObjects = 16;

// A PIN that does not stay in memory.
class Pin {
 public:
  explicit Pin(std::string text) : text_(std::move(text)) {}
  ~Pin() { ::explicit_bzero(text_.data(), text_.size()); }
  Pin(const Pin&) = delete;
  Pin& operator=(const Pin&) = delete;
  unsigned char* data() { return reinterpret_cast<unsigned char*>(text_.data()); }
  unsigned long size() const { return text_.size(); }

 private:
  std::string text_;
};

struct FreeUri {
  void operator()(P11KitUri* uri) const { p11_kit_uri_free(uri); }
};
using Uri = std::unique_ptr<P11KitUri, FreeUri>;

[[noreturn]] void token_failed(const std::string& uri, const char* what, CK_RV result) {
  std::string fix = "check the token with `p11tool --list-tokens` or `pkcs11-tool -L`";
  if (result == CKR_PIN_INCORRECT || result == CKR_PIN_LEN_RANGE || result == CKR_PIN_INVALID) {
    fix = "correct the PIN; the token locks itself after a few wrong ones";
  } else if (result == CKR_PIN_LOCKED) {
    fix = "unlock the token with its SO PIN or PUK";
  } else if (result == CKR_MECHANISM_INVALID || result == CKR_KEY_TYPE_INCONSISTENT) {
    fix = "use a token that signs by Ed25519 (CKM_EDDSA)";
  }
  throw Error({.what = what, .where = uri, .found = p11_kit_strerror(result), .fix = fix});
}

// Everything between "begins as a URI" and "is one that may be used".
Uri parse_uri(const std::string& text) {
  Uri uri(p11_kit_uri_new());
  if (!uri) throw std::bad_alloc();
  const int result = p11_kit_uri_parse(text.c_str(), P11_KIT_URI_FOR_ANY, uri.get());
  const auto refuse = [&text](std::string found) {
    throw UsageError({.what = "this names no key of a token",
                      .where = text.substr(0, text.find('?')),  // what follows may hold a PIN
                      .expected = "a PKCS#11 URI (RFC 7512), such as pkcs11:token=nadir;object=planner",
                      .found = std::move(found),
                      .fix = "`p11tool --list-all 'pkcs11:token=…'` prints the URIs of a token's keys"});
  };
  if (result != P11_KIT_URI_OK) refuse(p11_kit_uri_message(result));
  if (p11_kit_uri_get_pin_value(uri.get()) != nullptr) {
    throw UsageError(
        {.what = "a PIN on the command line",
         .where = text.substr(0, text.find('?')),
         .expected = fmt::format("pin-source=FILE in the URI, or the PIN in the environment ({})", kTokenPinVariable),
         .found = "pin-value, which every user of this machine can see",
         .fix = "remove it, and change the PIN"});
  }
  if (p11_kit_uri_any_unrecognized(uri.get()) != 0) refuse("an attribute that is not known");
  if (p11_kit_uri_get_attribute(uri.get(), CKA_LABEL) == nullptr &&
      p11_kit_uri_get_attribute(uri.get(), CKA_ID) == nullptr) {
    refuse("neither object= (the key's label) nor id=");
  }
  return uri;
}

std::unique_ptr<Pin> pin_of(const P11KitUri& uri, const std::optional<std::string>& from_environment) {
  const char* source = p11_kit_uri_get_pin_source(&uri);
  if (source == nullptr) return from_environment ? std::make_unique<Pin>(*from_environment) : nullptr;
  std::string path = source;
  if (path.starts_with("file:")) path = path.substr(5);
  if (path.starts_with("//")) path = path.substr(path.find('/', 2));
  require_private_mode(path);
  std::string pin = read_text_file(path, kMaxPin_bytes);
  while (!pin.empty() && (pin.back() == '\n' || pin.back() == '\r')) pin.pop_back();
  return std::make_unique<Pin>(std::move(pin));
}

// The modules: those of this machine, or the one of the URI.
class Modules {
 public:
  explicit Modules(const std::string& text, const P11KitUri& uri) {
    if (const char* path = p11_kit_uri_get_module_path(&uri)) {
      one_ = {p11_kit_module_load(path, 0), nullptr};
      if (one_[0] == nullptr) {
        throw UsageError({.what = "the PKCS#11 module cannot be loaded",
                          .where = path,
                          .expected = "a shared library for this machine, with its full path",
                          .found = last_message(),
                          .fix = "correct module-path, or leave it out to use the modules that p11-kit knows"});
      }
      if (const CK_RV result = p11_kit_module_initialize(one_[0]); result != CKR_OK) {
        p11_kit_module_release(one_[0]);
        token_failed(text, "the PKCS#11 module does not start", result);
      }
      return;
    }
    all_ = p11_kit_modules_load_and_initialize(0);
    if (all_ == nullptr) {
      throw Error({.what = "the PKCS#11 modules of this machine cannot be loaded",
                   .where = "/usr/share/p11-kit/modules",
                   .found = last_message(),
                   .fix = "name one with ?module-path=…"});
    }
  }
  ~Modules() {
    if (all_ != nullptr) p11_kit_modules_finalize_and_release(all_);
    if (one_[0] != nullptr) {
      p11_kit_module_finalize(one_[0]);
      p11_kit_module_release(one_[0]);
    }
  }
  Modules(const Modules&) = delete;
  Modules& operator=(const Modules&) = delete;

  CK_FUNCTION_LIST* const* list() const { return all_ != nullptr ? all_ : one_.data(); }

 private:
  static std::string last_message() {
    const char* message = p11_kit_message();
    return message != nullptr ? message : "p11-kit gave no reason";
  }

  CK_FUNCTION_LIST** all_ = nullptr;
  std::array<CK_FUNCTION_LIST*, 2> one_{};
};

std::string text_of(const unsigned char* padded, std::size_t size) {
  return printable(std::string_view(reinterpret_cast<const char*>(padded), p11_kit_space_strlen(padded, size)));
}

struct FoundToken {
  CK_FUNCTION_LIST* module = nullptr;
  CK_SLOT_ID slot = 0;
  CK_TOKEN_INFO info{};
};

// The one token that the URI means.
FoundToken find_token(const std::string& text, P11KitUri& uri, const Modules& modules) {
  std::vector<FoundToken> found;
  std::vector<std::string> others;
  for (CK_FUNCTION_LIST* const* module = modules.list(); *module != nullptr; ++module) {
    CK_INFO info{};
    if ((*module)->C_GetInfo(&info) != CKR_OK || p11_kit_uri_match_module_info(&uri, &info) == 0) continue;
    if (const char* wanted = p11_kit_uri_get_module_name(&uri)) {
      const std::unique_ptr<char, decltype(&std::free)> name(p11_kit_module_get_name(*module), &std::free);
      if (!name || std::string_view(name.get()) != wanted) continue;
    }
    std::array<CK_SLOT_ID, kMaxSlots> slots{};
    unsigned long count = slots.size();
    if ((*module)->C_GetSlotList(CK_TRUE, slots.data(), &count) != CKR_OK) continue;
    for (unsigned long i = 0; i < count; ++i) {
      CK_TOKEN_INFO token{};
      CK_SLOT_INFO slot{};
      if ((*module)->C_GetTokenInfo(slots[i], &token) != CKR_OK) continue;
      if ((*module)->C_GetSlotInfo(slots[i], &slot) != CKR_OK) continue;
      const CK_SLOT_ID wanted = p11_kit_uri_get_slot_id(&uri);
      const bool is_it = p11_kit_uri_match_token_info(&uri, &token) != 0 &&
                         p11_kit_uri_match_slot_info(&uri, &slot) != 0 &&
                         (wanted == ~CK_SLOT_ID{0} || wanted == slots[i]);
      const bool is_initialized = (token.flags & CKF_TOKEN_INITIALIZED) != 0;
      if (is_it && is_initialized) found.push_back({*module, slots[i], token});
      if (is_initialized) others.push_back(text_of(token.label, sizeof token.label));
    }
  }
  if (found.size() == 1) return found.front();
  std::ranges::sort(others);  // slots come in any order
  throw UsageError({.what = found.empty() ? "there is no such token" : "several tokens fit",
                    .where = text,
                    .expected = "one token",
                    .found = others.empty() ? "no token at all" : fmt::format("tokens {}", fmt::join(others, ", ")),
                    .fix = found.empty() ? "connect it, or correct token=; its module must be known to p11-kit"
                                         : "add serial= or slot-id="});
}

class TokenKey final : public KeyDevice {
 public:
  TokenKey(std::string text, const std::optional<std::string>& pin_of_environment)
      : text_(std::move(text)), uri_(parse_uri(text_)), modules_(text_, *uri_) {
    const FoundToken token = find_token(text_, *uri_, modules_);
    call_ = token.module;
    CK_RV result = call_->C_OpenSession(token.slot, CKF_SERIAL_SESSION, nullptr, nullptr, &session_);
    if (result != CKR_OK) token_failed(text_, "the token opens no session", result);
    try {
      pin_ = pin_of(*uri_, pin_of_environment);
      if ((token.info.flags & CKF_LOGIN_REQUIRED) != 0) log_in(token.info.flags);
      key_ = find_private_key();
      public_key_.emplace(PublicKey::from_raw(find_public_key()));
    } catch (...) {
      call_->C_CloseSession(session_);
      throw;
    }
  }
  ~TokenKey() override { call_->C_CloseSession(session_); }
  TokenKey(const TokenKey&) = delete;
  TokenKey& operator=(const TokenKey&) = delete;

  const PublicKey& public_key() const override { return *public_key_; }

  Signature sign(ByteView message) const override {
    CK_MECHANISM mechanism{CKM_EDDSA, nullptr, 0};
    CK_RV result = call_->C_SignInit(session_, &mechanism, key_);
    if (result != CKR_OK) token_failed(text_, "the token does not sign with this key", result);
    if (asks_each_time_) {
      result = call_->C_Login(session_, CKU_CONTEXT_SPECIFIC, pin_ ? pin_->data() : nullptr, pin_ ? pin_->size() : 0);
      if (result != CKR_OK) token_failed(text_, "the token does not accept the PIN for a signature", result);
    }
    Signature signature{};
    unsigned char nothing = 0;  // tokens take no null pointer for an empty message
    unsigned long size = signature.size();
    result = call_->C_Sign(session_, message.empty() ? &nothing : const_cast<unsigned char*>(message.data()),
                           message.size(), signature.data(), &size);
    if (result != CKR_OK) token_failed(text_, "the token does not sign", result);
    if (size != signature.size() || !public_key_->verifies(message, signature)) {
      throw Error({.what = "the token made a wrong signature",
                   .where = text_,
                   .expected = "one that its public key verifies",
                   .found = fmt::format("{} bytes that it does not", size),
                   .fix = "private and public key of this label or id may belong to different pairs"});
    }
    return signature;
  }

 private:
  void log_in(CK_FLAGS flags) {
    const bool on_the_device = (flags & CKF_PROTECTED_AUTHENTICATION_PATH) != 0;
    if (!pin_ && !on_the_device) {
      throw UsageError(
          {.what = "the token asks for its PIN",
           .where = text_,
           .expected = fmt::format("?pin-source=FILE in the URI, or {} in the environment", kTokenPinVariable),
           .found = "neither",
           .fix = "write the PIN into a file of mode 0600 and name it"});
    }
    if ((flags & CKF_USER_PIN_FINAL_TRY) != 0) {
      throw Error({.what = "the token has one try left before it locks itself",
                   .where = text_,
                   .found = "wrong PINs before",
                   .fix = "log in once by `pkcs11-tool --login`, which resets the counter"});
    }
    const CK_RV result = call_->C_Login(session_, CKU_USER, pin_ ? pin_->data() : nullptr, pin_ ? pin_->size() : 0);
    if (result != CKR_OK && result != CKR_USER_ALREADY_LOGGED_IN) {
      token_failed(text_, "the token does not accept the PIN", result);
    }
  }

  std::vector<CK_OBJECT_HANDLE> find(std::vector<CK_ATTRIBUTE> wanted) const {
    CK_RV result = call_->C_FindObjectsInit(session_, wanted.data(), wanted.size());
    if (result != CKR_OK) token_failed(text_, "the token cannot be searched", result);
    std::vector<CK_OBJECT_HANDLE> objects(kMaxObjects);
    unsigned long count = 0;
    result = call_->C_FindObjects(session_, objects.data(), objects.size(), &count);
    call_->C_FindObjectsFinal(session_);
    if (result != CKR_OK) token_failed(text_, "the token cannot be searched", result);
    objects.resize(count);
    return objects;
  }

  Bytes value_of(CK_OBJECT_HANDLE object, CK_ATTRIBUTE_TYPE type) const {
    CK_ATTRIBUTE attribute{type, nullptr, 0};
    if (call_->C_GetAttributeValue(session_, object, &attribute, 1) != CKR_OK || attribute.ulValueLen == ~0UL ||
        attribute.ulValueLen > 4096) {
      return {};
    }
    Bytes value(attribute.ulValueLen);
    attribute.pValue = value.data();
    if (call_->C_GetAttributeValue(session_, object, &attribute, 1) != CKR_OK) return {};
    value.resize(attribute.ulValueLen);
    return value;
  }

  CK_OBJECT_HANDLE find_private_key() {
    CK_OBJECT_CLASS kind = CKO_PRIVATE_KEY;
    std::vector<CK_ATTRIBUTE> wanted{{CKA_CLASS, &kind, sizeof kind}};
    for (const CK_ATTRIBUTE_TYPE type : {CKA_LABEL, CKA_ID}) {
      if (const CK_ATTRIBUTE* attribute = p11_kit_uri_get_attribute(uri_.get(), type)) wanted.push_back(*attribute);
    }
    const std::vector<CK_OBJECT_HANDLE> keys = find(wanted);
    if (keys.size() != 1) {
      throw UsageError({.what = keys.empty() ? "the token has no such private key" : "several private keys fit",
                        .where = text_,
                        .expected = "one private key of this object= (label) and id=",
                        .found = std::to_string(keys.size()),
                        .fix = "`pkcs11-tool --login -O` lists the token's keys"});
    }
    CK_KEY_TYPE type = 0;
    CK_ATTRIBUTE attribute{CKA_KEY_TYPE, &type, sizeof type};
    if (call_->C_GetAttributeValue(session_, keys.front(), &attribute, 1) != CKR_OK || type != CKK_EC_EDWARDS) {
      throw UsageError({.what = "this key is for another algorithm",
                        .where = text_,
                        .expected = "an Ed25519 key (CKK_EC_EDWARDS)",
                        .found = fmt::format("key type {:#x}", type),
                        .fix = "make one: pkcs11-tool --login --keypairgen --key-type EC:edwards25519 --label …"});
    }
    const Bytes always = value_of(keys.front(), CKA_ALWAYS_AUTHENTICATE);
    asks_each_time_ = always.size() == 1 && always[0] == CK_TRUE;
    return keys.front();
  }

  // The point is a DER octet string of 32 bytes, or the 32 bytes themselves (versions of PKCS#11 differ).
  Bytes find_public_key() const {
    const Bytes id = value_of(key_, CKA_ID), label = value_of(key_, CKA_LABEL);
    CK_OBJECT_CLASS kind = CKO_PUBLIC_KEY;
    for (const auto& [type, value] : {std::pair{CKA_ID, &id}, std::pair{CKA_LABEL, &label}}) {
      if (value->empty()) continue;
      const auto keys =
          find({{CKA_CLASS, &kind, sizeof kind}, {type, const_cast<std::uint8_t*>(value->data()), value->size()}});
      for (const CK_OBJECT_HANDLE key : keys) {
        Bytes point = value_of(key, CKA_EC_POINT);
        if (point.size() == kRaw_bytes + 2 && point[0] == 0x04 && point[1] == kRaw_bytes) {
          point.erase(point.begin(), point.begin() + 2);
        }
        if (point.size() == kRaw_bytes) return point;
      }
    }
    throw UsageError({.what = "the token has no public key for this private one",
                      .where = text_,
                      .expected = "a public key of Ed25519 with the same id or label",
                      .found = "none",
                      .fix = "make the pair on the token, or import its public key beside it"});
  }

  std::string text_;
  Uri uri_;
  Modules modules_;
  CK_FUNCTION_LIST* call_ = nullptr;
  CK_SESSION_HANDLE session_ = 0;
  CK_OBJECT_HANDLE key_ = 0;
  bool asks_each_time_ = false;
  std::unique_ptr<Pin> pin_;
  std::optional<PublicKey> public_key_;
};

}  // namespace

bool is_token_uri(std::string_view text) { return text.starts_with(kScheme); }

void check_token_uri(const std::string& text) { static_cast<void>(parse_uri(text)); }

PrivateKey open_token_key(std::string_view uri, const std::optional<std::string>& pin) {
  p11_kit_be_quiet();
  return PrivateKey::in_device(std::make_unique<TokenKey>(std::string(uri), pin));
}

PrivateKey read_signing_key(const std::filesystem::path& file_or_uri) {
  if (!is_token_uri(file_or_uri.native())) return PrivateKey::read(file_or_uri);
  const char* pin = std::getenv(kTokenPinVariable);  // NOLINT(concurrency-mt-unsafe): before any thread
  return open_token_key(file_or_uri.native(), pin == nullptr ? std::nullopt : std::optional<std::string>(pin));
}

}  // namespace nadir
