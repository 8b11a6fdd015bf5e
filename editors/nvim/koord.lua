-- Neovim 0.11 and newer: put this into ~/.config/nvim/lsp/koord.lua, and say
-- vim.lsp.enable("koord") in init.lua. The syntax is in ../vim.
-- Files of YAML are its own where a program stands beside them: they may be configurations.
-- `:lua vim.lsp.codelens.run()` in a line with a broken claim opens the run that breaks it.
return {
  cmd = { "koord", "lsp" },
  filetypes = { "koord", "yaml" },
  root_dir = function(buffer, start)
    local folder = vim.fs.dirname(vim.api.nvim_buf_get_name(buffer))
    if vim.bo[buffer].filetype == "koord" or vim.fn.glob(folder .. "/*.krd") ~= "" then
      start(vim.fs.root(buffer, ".git"))
    end
  end,
  init_options = { verify = { on = "change" } },
  handlers = {
    -- verdicts as signs in the gutter, and as lenses above the claims
    ["koord/verdicts"] = function(_, told)
      local space = vim.api.nvim_create_namespace("koord")
      local buffer = vim.uri_to_bufnr(told.uri)
      if not vim.api.nvim_buf_is_loaded(buffer) then
        return
      end
      vim.api.nvim_buf_clear_namespace(buffer, space, 0, -1)
      local signs = { holds = "✓", bounded = "✓", vacuous = "∅", violated = "✗", unknown = "?" }
      local groups = { violated = "DiagnosticError", vacuous = "DiagnosticWarn", unknown = "DiagnosticInfo" }
      for _, mark in ipairs(told.marks) do
        if mark.line < vim.api.nvim_buf_line_count(buffer) then
          vim.api.nvim_buf_set_extmark(buffer, space, mark.line, 0, {
            sign_text = mark.stale and "…" or signs[mark.kind],
            sign_hl_group = groups[mark.kind] or "DiagnosticOk",
          })
        end
      end
      vim.lsp.codelens.refresh({ bufnr = buffer })
    end,
  },
}
