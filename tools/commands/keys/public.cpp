// nadir keys public: the public key of a private one, in a file or in a token.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "token_keys/token_key.hpp"
#include "trust/keys.hpp"

namespace nadir {
namespace {

class KeysPublicCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "public"; }
  std::string_view summary() const override { return "write the public key of a private one, or of a token's"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path key_;
  std::optional<std::filesystem::path> out_;
};

std::string_view KeysPublicCommand::details() const {
  return R"(Roots of trust appoint public keys. That of a key in a token (smart card, HSM) is read from it through
PKCS#11; the PIN comes from ?pin-source=FILE in the URI or from NADIR_PKCS11_PIN. Without --out the PEM
goes to standard output. Existing files are never overwritten.)";
}

std::string_view KeysPublicCommand::examples() const {
  return R"(nadir keys public "pkcs11:token=nadir;object=planner?pin-source=pin.txt" --out planner.pub.pem
nadir keys public planner.key.pem)";
}

void KeysPublicCommand::setup(Options& options) {
  options.positional("KEY", key_, "private key: a PEM file, or the PKCS#11 URI of a token's key").required();
  options.value("--out", out_, "KEY.pub.pem", "file to create");
}

int KeysPublicCommand::run(Context& context) {
  const PublicKey key = read_signing_key(key_).public_key();
  if (out_) write_new_file(*out_, key.pem());
  if (context.json) {
    nlohmann::json result{{"keyid", key.id()}, {"pem", key.pem()}};
    if (out_) result["public_key"] = out_->string();
    print_json(context.out, result);
  } else if (out_) {
    print_figures(context.out, {{"public key", out_->string()}, {"key id", key.id()}});
  } else {
    context.out << key.pem();
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_keys_public() { return std::make_unique<KeysPublicCommand>(); }

}  // namespace nadir
