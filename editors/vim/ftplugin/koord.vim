" Koord: layout and comments as `koord fmt` has them
if exists('b:did_ftplugin')
  finish
endif
let b:did_ftplugin = 1
setlocal expandtab shiftwidth=4 softtabstop=4 comments=:#,:// commentstring=#\ %s
setlocal foldmethod=indent foldlevel=99
let b:undo_ftplugin = 'setlocal expandtab< shiftwidth< softtabstop< comments< commentstring< foldmethod< foldlevel<'
