// nadir keys create: a new Ed25519 key pair as two PEM files.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <ostream>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "trust/keys.hpp"

namespace nadir {
namespace {

class KeysCreateCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "create"; }
  std::string_view summary() const override {
    return "create an Ed25519 key pair for signing packages or roots of trust";
  }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path out_;
};

std::string_view KeysCreateCommand::details() const {
  return R"(Writes NAME.key.pem (private, PKCS#8, mode 0600: keep it offline) and NAME.pub.pem (public).
Existing files are never overwritten. Keys made by `openssl genpkey -algorithm ed25519` work too.)";
}

std::string_view KeysCreateCommand::examples() const {
  return R"(nadir keys create --out planner
nadir keys create --out root)";
}

void KeysCreateCommand::setup(Options& options) {
  options.value("--out", out_, "NAME", "name of the files, without .key.pem and .pub.pem").required();
}

int KeysCreateCommand::run(Context& context) {
  const KeyFiles files = create_key_files(out_);
  const std::string id = PublicKey::read(files.public_key).id();
  if (context.json) {
    print_json(context.out,
               {{"private_key", files.private_key.string()}, {"public_key", files.public_key.string()}, {"keyid", id}});
  } else {
    print_figures(
        context.out,
        {{"private key", files.private_key.string()}, {"public key", files.public_key.string()}, {"key id", id}});
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_keys_create() { return std::make_unique<KeysCreateCommand>(); }

}  // namespace nadir
